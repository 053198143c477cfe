"""glTF 2.0 documents with one buffer, written as .glb, or as .gltf with the buffer inside."""

from __future__ import annotations

import base64
import json
import struct
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from carigs.system.files import writing

POINTS, TRIANGLES = 0, 4
"""Modes of a primitive."""
ARRAY_BUFFER, ELEMENT_ARRAY_BUFFER = 34962, 34963
"""Targets of a buffer view: vertex attributes, and indices."""
COMPONENT_TYPES = {np.dtype("<f4"): 5126, np.dtype("<u4"): 5125, np.dtype("<u2"): 5123}
SHAPES = {(): "SCALAR", (3,): "VEC3", (4,): "VEC4", (16,): "MAT4"}
DENSE = 0.6
"""Share of rows other than 0 from which an array is stored with all of its rows."""


class GltfBuffer:
    """The arrays of a document: their bytes, and the entries `bufferViews` and `accessors` that describe them."""

    def __init__(self) -> None:
        self.content = bytearray()
        self.views: list[dict[str, int]] = []
        self.accessors: list[dict[str, Any]] = []

    def add(self, array: np.ndarray, target: int | None = None, *, bounds: bool = False, short: bool = False) -> int:
        """Append an array.

        Args:
            array: Numbers of shape (n,), (n, 3), (n, 4) or (n, 16). Whole numbers become uint32, others float32.
            target: What vertex data is used for; None for other data.
            bounds: Whether the least and greatest values are stated, which positions and times of keyframes need.
            short: Whether whole numbers become uint16, as joints must.

        Returns:
            Index of its accessor.
        """
        array = np.ascontiguousarray(array, ("<u2" if short else "<u4") if array.dtype.kind in "iu" else "<f4")
        accessor = {
            "bufferView": self._view(array, target),
            "componentType": COMPONENT_TYPES[array.dtype],
            "count": len(array),
            "type": SHAPES[array.shape[1:]],
        }
        if bounds:
            accessor |= {"min": array.min(0).reshape(-1).tolist(), "max": array.max(0).reshape(-1).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def add_target(self, displacement: np.ndarray) -> int:
        """Append displacements of a morph target, of which only those other than 0 are stored if they are few.

        Args:
            displacement: Of every vertex (v, 3).

        Returns:
            Index of the accessor.
        """
        displacement = np.ascontiguousarray(displacement, "<f4")
        moved = np.flatnonzero(displacement.any(axis=1))
        if not 0 < len(moved) < DENSE * len(displacement):
            return self.add(displacement, ARRAY_BUFFER, bounds=True)
        accessor = {
            "componentType": COMPONENT_TYPES[displacement.dtype],
            "count": len(displacement),
            "type": "VEC3",
            "min": displacement.min(0).tolist(),
            "max": displacement.max(0).tolist(),
            "sparse": {
                "count": len(moved),
                "indices": {"bufferView": self._view(moved.astype("<u4"), None), "componentType": 5125},
                "values": {"bufferView": self._view(displacement[moved], None)},
            },
        }
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def _view(self, array: np.ndarray, target: int | None) -> int:
        view = {"buffer": 0, "byteOffset": len(self.content), "byteLength": array.nbytes}
        self.views.append(view | ({} if target is None else {"target": target}))
        self.content += array.tobytes() + b"\0" * (-array.nbytes % 4)
        return len(self.views) - 1


def write_gltf(file: Path, buffer: GltfBuffer, document: dict[str, Any]) -> None:
    """Write a document.

    Args:
        file: Path to write: .glb, or .gltf with the buffer as base64.
        buffer: Its arrays.
        document: Its other entries, such as `meshes` and `nodes`; the first scene holds node 0.
    """
    size = {"byteLength": len(buffer.content)}
    embedded = file.suffix.lower() == ".gltf"
    if embedded:
        encoded = base64.b64encode(buffer.content).decode()
        size["uri"] = f"data:application/octet-stream;base64,{encoded}"
    document = {
        "asset": {"version": "2.0", "generator": f"carigs {version('carigs')}"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        **document,
        "buffers": [size],
        "bufferViews": buffer.views,
        "accessors": buffer.accessors,
    }
    text = json.dumps(document, separators=(",", ":")).encode()
    with writing(file) as part:
        part.write_bytes(text if embedded else _glb(text, bytes(buffer.content)))


def _glb(text: bytes, content: bytes) -> bytes:
    """The binary container: a header and two chunks, padded to multiples of four bytes."""
    text += b" " * (-len(text) % 4)
    content += b"\0" * (-len(content) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(content), b"BIN\0") + content
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
