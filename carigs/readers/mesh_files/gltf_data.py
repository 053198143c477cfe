"""The numbers of a glTF document: accessors, sparse ones too, and the buffers that they lie in."""

from __future__ import annotations

import binascii
from pathlib import Path, PureWindowsPath
from typing import Any
from urllib.parse import unquote

import numpy as np
from jaxtyping import Shaped

from carigs.errors import InputError
from carigs.readers.json_files import json_field
from carigs.readers.limits import MAX_TEXT_BYTES, read_bytes
from carigs.readers.mesh_files.gltf_extensions import check_compression

INDICES = {5121: "u1", 5123: "<u2", 5125: "<u4"}
"""NumPy's types of the component types of indices."""
_COLUMNS = {"VEC3": 3, "SCALAR": 1}


class GltfData:
    """A document with its binary chunk.

    Args:
        document: The JSON document.
        binary: The binary chunk, which buffer 0 stands for if it has no `uri`; None if there is none.
        file: The file, for messages; buffers in other files lie in its folder.
    """

    def __init__(self, document: dict[str, Any], binary: bytes | None, file: str | Path) -> None:
        self._document, self._binary, self._file = document, binary, file
        self._buffers: dict[int, bytes] = {}

    def entry(self, name: str, index: int) -> dict[str, Any]:
        """An object of a list of the document.

        Args:
            name: Key of the list.
            index: Number of the object.

        Returns:
            The object.

        Raises:
            InputError: If there is none.
        """
        entries = json_field(self._document, name, list, file=self._file)
        if not 0 <= index < len(entries) or not isinstance(entries[index], dict):
            raise InputError("no such object", file=self._file, field=f"{name}[{index}]")
        return entries[index]

    def numbers(self, index: int, kind: str, types: dict[int, str], max_count: int) -> Shaped[np.ndarray, "n k"]:
        """The numbers of an accessor (glTF 2.0, 3.6.2).

        Args:
            index: Number of the accessor.
            kind: `VEC3` or `SCALAR`.
            types: NumPy's types of the component types that it may have.
            max_count: Most elements of an accessor that needs memory of its own.

        Returns:
            A view of the buffer, unless they are sparse or normalised.

        Raises:
            InputError: If the accessor is of another type, or claims more than there is.
        """
        entry, where = self.entry("accessors", index), f"accessors[{index}]"
        component = self._whole(entry, "componentType", where)
        if entry.get("type") != kind or component not in types:
            problem = f"expected a {kind} of the component type {' or '.join(map(str, types))}"
            raise InputError(problem, file=self._file, field=where)
        dtype, count = np.dtype(types[component]), self._whole(entry, "count", where)
        if "sparse" in entry and "bufferView" not in entry:
            if count > max_count:
                raise InputError(f"{count} elements; at most {max_count} are read", file=self._file, field=where)
            numbers = np.zeros((count, _COLUMNS[kind]), dtype)
        else:
            numbers = self._rows(entry, dtype, count, _COLUMNS[kind], where)
        if "sparse" in entry:
            numbers = self._with_sparse(numbers, json_field(entry, "sparse", dict, file=self._file, where=where), where)
        if entry.get("normalized") is True and dtype.kind in "iu" and kind == "VEC3":
            return np.maximum(numbers / np.iinfo(dtype).max, -1)  # glTF 2.0, section 3.11
        return numbers

    def _with_sparse(
        self, numbers: Shaped[np.ndarray, "n k"], sparse: dict[str, Any], where: str
    ) -> Shaped[np.ndarray, "n k"]:
        """Replace the rows that a sparse accessor lists (glTF 2.0, 3.6.2.3)."""
        field = f"{where}.sparse"
        count = self._whole(sparse, "count", field)
        indices, values = (json_field(sparse, key, dict, file=self._file, where=field) for key in ("indices", "values"))
        component = self._whole(indices, "componentType", f"{field}.indices")
        if component not in INDICES:
            raise InputError("expected whole numbers", file=self._file, field=f"{field}.indices.componentType")
        at = self._rows(indices, np.dtype(INDICES[component]), count, 1, f"{field}.indices")[:, 0].astype(np.int64)
        if (np.diff(at) <= 0).any() or (count and at[-1] >= len(numbers)):
            problem = f"expected increasing numbers below {len(numbers)}"
            raise InputError(problem, file=self._file, field=f"{field}.indices")
        replaced = numbers.copy()
        replaced[at] = self._rows(values, numbers.dtype, count, numbers.shape[1], f"{field}.values")
        return replaced

    def _rows(
        self, source: dict[str, Any], dtype: np.dtype, count: int, columns: int, where: str
    ) -> Shaped[np.ndarray, "n k"]:
        """Rows of numbers in the view that a source names."""
        number = self._whole(source, "bufferView", where)
        view, inside = self.entry("bufferViews", number), f"bufferViews[{number}]"
        content = self._buffer(view, inside)
        size = columns * dtype.itemsize
        start, length = self._whole(view, "byteOffset", inside, 0), self._whole(view, "byteLength", inside)
        first, stride = self._whole(source, "byteOffset", where, 0), self._whole(view, "byteStride", inside, size)
        end = first + (count - 1) * stride + size if count else 0
        if stride < size or end > length or start + length > len(content):
            raise InputError(f"{count} x {stride} bytes, more than there are", file=self._file, field=where)
        if count == 0:
            return np.zeros((0, columns), dtype)
        return np.ndarray((count, columns), dtype, content, start + first, (stride, dtype.itemsize))

    def _buffer(self, view: dict[str, Any], inside: str) -> bytes:
        """The content of the buffer of a view."""
        index = self._whole(view, "buffer", inside)
        entry, where = self.entry("buffers", index), f"buffers[{index}]"
        if index not in self._buffers:
            if "uri" in entry:
                self._buffers[index] = self._at_uri(json_field(entry, "uri", str, file=self._file, where=where), where)
            else:
                if index != 0 or "extensions" in entry:  # a buffer without data
                    check_compression(view, self._file, inside)
                if index != 0 or self._binary is None:
                    raise InputError("no data in a binary chunk, and no uri", file=self._file, field=where)
                self._buffers[index] = self._binary
        return self._buffers[index]

    def _at_uri(self, uri: str, where: str) -> bytes:
        """The bytes in a data URI (RFC 2397), or of a file in the folder of the document."""
        head, comma, data = uri.partition(",")
        if head.startswith("data:") and head.endswith(";base64") and comma:
            try:
                return binascii.a2b_base64(data)
            except binascii.Error as error:
                raise InputError(f"broken base64 ({error})", file=self._file, field=f"{where}.uri") from error
        name = unquote(uri)
        path = PureWindowsPath(name)  # which takes / and backslashes
        if not path.parts or path.anchor or ".." in path.parts or ":" in name:
            problem = f"data outside the file's folder: {name[:60]!r}; save the mesh as .glb"
            raise InputError(problem, file=self._file, field=f"{where}.uri")
        return read_bytes(Path(self._file).parent / path.as_posix(), MAX_TEXT_BYTES, "buffer of a .gltf")

    def _whole(self, source: dict[str, Any], key: str, field: str, default: int | None = None) -> int:
        if key not in source and default is not None:
            return default
        value = json_field(source, key, int, file=self._file, where=field)
        if value < 0:
            raise InputError(f"expected 0 or larger, found {value}", file=self._file, field=f"{field}.{key}")
        return value
