"""Reader of the triangles of glTF 2.0, .glb and .gltf: the meshes of a scene in world coordinates.

Materials, textures and animations are ignored. Meshes with joints or morph targets are read as their positions stand,
with a warning. Data must lie in the file or in its folder; compressed meshes are refused. Quantised positions are read.
"""

from __future__ import annotations

import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float64, Int64
from scipy.spatial.transform import Rotation

from carigs.errors import CarigsWarning, InputError
from carigs.readers.arrays import checked_array
from carigs.readers.json_files import json_field, parse_json
from carigs.readers.limits import MAX_TEXT_BYTES, max_unpacked_bytes
from carigs.readers.mesh_files.gltf_data import INDICES, GltfData
from carigs.readers.mesh_files.gltf_extensions import QUANTIZATION, check_compression, check_extensions

MAX_CORNERS, CORNER_BYTES = 60_000_000, 32
"""Most vertices, and most corners of triangles, of all meshes, and what each takes in memory: nodes can show one mesh
any number of times, so that a small file becomes a large one (`max_unpacked_bytes`)."""
POINTS_AND_LINES, TRIANGLES = (0, 1, 2, 3), 4
"""Modes of a primitive."""
POSITIONS = {5126: "<f4"}
QUANTISED_POSITIONS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", **POSITIONS}
"""NumPy's types of the component types that positions may have."""


def parse_glb(content: bytes, file: str | Path) -> tuple[Float64[np.ndarray, "v 3"], Int64[np.ndarray, "f 3"]]:
    """Parse positions and triangles.

    Args:
        content: The file's bytes.
        file: Its name, for messages.

    Returns:
        Positions in the unit of the file, and vertex numbers from 0, node by node. Vertices that several primitives of
        a mesh share appear once.

    Raises:
        InputError: If the file is damaged, claims more than it holds, or has data, primitives or extensions that are
            not read.

    Warns:
        CarigsWarning: The file uses an extension without which other triangles are shown, or joints or morph targets
            that would move vertices.
    """
    document, binary = _chunks(content, file)
    return _Scene(document, binary, file, len(binary or b"")).triangles()


def parse_gltf(content: bytes, file: str | Path) -> tuple[Float64[np.ndarray, "v 3"], Int64[np.ndarray, "f 3"]]:
    """Parse positions and triangles of a .gltf, whose data lie in it or in files of its folder.

    Args:
        content: The file's bytes.
        file: Its name.

    Returns:
        As `parse_glb`.

    Raises:
        InputError: As for `parse_glb`, and for data outside of the folder.

    Warns:
        CarigsWarning: As for `parse_glb`.
    """
    document = parse_json(content, file)
    if not isinstance(document, dict):
        raise InputError("expected an object", file=file)
    buffers = document.get("buffers")
    entries = buffers if isinstance(buffers, list) else []
    stated = sum(n for entry in entries if isinstance(entry, dict) and type(n := entry.get("byteLength")) is int)
    return _Scene(document, None, file, max(len(content), min(stated, MAX_TEXT_BYTES))).triangles()


def _chunks(content: bytes, file: str | Path) -> tuple[dict[str, Any], bytes | None]:
    """The JSON document, and the binary chunk that its buffer stands for."""
    chunks: list[tuple[bytes, bytes]] = []
    if content[:8] != struct.pack("<4sI", b"glTF", 2):
        raise InputError("not a readable mesh (no glTF 2.0)", file=file)
    position, end = 12, int.from_bytes(content[8:12], "little")
    while position < end and len(chunks) < 2:
        if end > len(content) or position + 8 > end:
            raise InputError("not a readable mesh (cut off)", file=file)
        length, kind = struct.unpack_from("<I4s", content, position)
        chunks.append((kind, content[position + 8 : position + 8 + length]))
        position += 8 + length
    if position > end or [kind for kind, _ in chunks] not in ([b"JSON"], [b"JSON", b"BIN\0"]):
        raise InputError("not a readable mesh (expected a JSON chunk and a binary one)", file=file)
    document = parse_json(chunks[0][1].rstrip(b" \0"), file, "JSON")
    if not isinstance(document, dict):
        raise InputError("expected an object", file=file, field="JSON")
    return document, chunks[1][1] if len(chunks) > 1 else None


class _Scene:
    """A document with its binary chunk."""

    def __init__(self, document: dict[str, Any], binary: bytes | None, file: str | Path, size: int) -> None:
        self.document, self.file = document, file
        self.data = GltfData(document, binary, file)
        self.position_types = QUANTISED_POSITIONS if QUANTIZATION in check_extensions(document, file) else POSITIONS
        self.vertices: list[Float64[np.ndarray, "_ 3"]] = []
        self.faces: list[Int64[np.ndarray, "_ 3"]] = []
        self.num_vertices = self.num_corners = 0
        self.max_corners = min(MAX_CORNERS, max_unpacked_bytes(size) // CORNER_BYTES)

    def triangles(self) -> tuple[Float64[np.ndarray, "v 3"], Int64[np.ndarray, "f 3"]]:
        """The meshes of all nodes of the scene."""
        waiting = [(index, np.eye(4)) for index in reversed(self._roots())]
        seen: set[int] = set()
        while waiting:
            index, world_from_parent = waiting.pop()
            node, where = self.data.entry("nodes", index), f"nodes[{index}]"
            if index in seen:
                raise InputError("hangs on two nodes, or on itself", file=self.file, field=where)
            seen.add(index)
            with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is found in the vertices
                world_from_node = world_from_parent @ self._transform(node, where)
            if "mesh" in node:
                mesh = json_field(node, "mesh", int, file=self.file, where=where)
                self._warn_of_deformation(node, mesh, where)
                # glTF 2.0, 3.7.3.3: joints alone place a mesh with a skin.
                self._add_mesh(mesh, np.eye(4) if "skin" in node else world_from_node)
            children = self._indices(node, "children", where)
            waiting += [(child, world_from_node) for child in reversed(children)]
        nothing = np.zeros((0, 3))
        return np.concatenate([nothing, *self.vertices]), np.concatenate([nothing.astype(np.int64), *self.faces])

    def _warn_of_deformation(self, node: dict[str, Any], mesh: int, where: str) -> None:
        """Say what would move the vertices and is not read."""
        weights = node.get("weights", self.data.entry("meshes", mesh).get("weights", []))
        if "skin" in node:
            problem = "its joints (skin) are not applied; positions are read as the mesh has them"
            warnings.warn(f"{self.file}: {where}: {problem}", CarigsWarning, stacklevel=4)
        if isinstance(weights, list) and any(weight != 0 for weight in weights):
            problem = "its morph targets have weights, which are not applied"
            warnings.warn(f"{self.file}: {where}: {problem}", CarigsWarning, stacklevel=4)

    def _roots(self) -> list[int]:
        """Nodes of the first scene; without scenes those that are nobody's children."""
        if "scenes" in self.document:
            index = json_field(self.document, "scene", int, file=self.file) if "scene" in self.document else 0
            return self._indices(self.data.entry("scenes", index), "nodes", f"scenes[{index}]")
        nodes = json_field(self.document, "nodes", list, file=self.file)
        children = {k for i, node in enumerate(nodes) for k in self._indices(node, "children", f"nodes[{i}]")}
        return [i for i in range(len(nodes)) if i not in children]

    def _add_mesh(self, index: int, world_from_node: Float64[np.ndarray, "4 4"]) -> None:
        first_of: dict[int, int] = {}  # the first vertex of each accessor of positions
        mesh, where = self.data.entry("meshes", index), f"meshes[{index}]"
        for k, primitive in enumerate(json_field(mesh, "primitives", list, file=self.file, where=where)):
            field = f"{where}.primitives[{k}]"
            attributes = json_field(primitive, "attributes", dict, file=self.file, where=field)
            mode = json_field(primitive, "mode", int, file=self.file, where=field) if "mode" in primitive else TRIANGLES
            if mode in POINTS_AND_LINES:
                continue
            if mode != TRIANGLES:
                raise InputError("only lists of triangles are read", file=self.file, field=f"{field}.mode")
            accessor = json_field(attributes, "POSITION", int, file=self.file, where=f"{field}.attributes")
            self._check_data(primitive, accessor, field)
            positions = self.data.numbers(accessor, "VEC3", self.position_types, self.max_corners)
            if "indices" in primitive:
                indices = json_field(primitive, "indices", int, file=self.file, where=field)
                corners = self.data.numbers(indices, "SCALAR", INDICES, self.max_corners)[:, 0].astype(np.int64)
            else:
                corners = np.arange(len(positions))
            if len(corners) % 3 or (len(corners) and corners.max() >= len(positions)):
                raise InputError("indices that are no triangles of its vertices", file=self.file, field=field)
            if accessor not in first_of:
                first_of[accessor] = self._add_vertices(positions, world_from_node)
            faces = corners.reshape(-1, 3) + first_of[accessor]
            with np.errstate(over="ignore", invalid="ignore"):
                is_mirrored = np.linalg.det(world_from_node[:3, :3]) < 0  # which reverses the corners: glTF 2.0, 3.7.4
            self.faces.append(faces[:, ::-1] if is_mirrored else faces)
            self.num_corners += len(corners)
            if max(self.num_vertices, self.num_corners) > self.max_corners:
                raise InputError(f"more than {self.max_corners} corners of triangles", file=self.file, field=where)

    def _add_vertices(self, positions: np.ndarray, world_from_node: Float64[np.ndarray, "4 4"]) -> int:
        first = self.num_vertices
        with np.errstate(over="ignore", invalid="ignore"):
            moved = positions.astype(np.float64) @ world_from_node[:3, :3].T + world_from_node[:3, 3]
        self.vertices.append(moved)
        self.num_vertices += len(moved)
        return first

    def _transform(self, node: dict[str, Any], where: str) -> Float64[np.ndarray, "4 4"]:
        """parent_from_node: a matrix by columns, or translation, rotation (xyzw) and scale."""

        def numbers(key: str, default: list[float]) -> Float64[np.ndarray, " n"]:
            field = f"{where}.{key}"
            values = {field: json_field(node, key, list, file=self.file, where=where) if key in node else default}
            return checked_array(values, field, (len(default),), np.float64, file=self.file)

        if not node.keys() & {"matrix", "translation", "rotation", "scale"}:
            return np.eye(4)
        if "matrix" in node:
            return numbers("matrix", [0.0] * 16).reshape(4, 4).T
        quaternion = numbers("rotation", [0.0, 0.0, 0.0, 1.0])
        if not 0.9 < np.linalg.norm(quaternion) < 1.1:
            raise InputError("no unit quaternion", file=self.file, field=f"{where}.rotation")
        transform = np.eye(4)
        transform[:3, :3] = Rotation.from_quat(quaternion).as_matrix() * numbers("scale", [1.0, 1.0, 1.0])
        transform[:3, 3] = numbers("translation", [0.0, 0.0, 0.0])
        return transform

    def _check_data(self, primitive: dict[str, Any], accessor: int, where: str) -> None:
        """Name the compression of a primitive whose positions are stored nowhere else."""
        if "bufferView" not in self.data.entry("accessors", accessor):
            check_compression(primitive, self.file, where)

    def _indices(self, entry: Any, key: str, where: str) -> list[int]:
        if isinstance(entry, dict) and key not in entry:
            return []
        values = json_field(entry, key, list, file=self.file, where=where)
        if not all(type(value) is int for value in values):
            raise InputError("expected whole numbers", file=self.file, field=f"{where}.{key}")
        return values
