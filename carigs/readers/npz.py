"""Reader of NumPy's .npy and .npz files that trusts no number of the file before it is checked.

`numpy.load` allocates what a header claims, raises about ten types of exceptions for damaged files, and returns the
first of two members of one name. Here the sizes of all members are checked against limits and against the file before
anything is allocated, no member is unpacked beyond the size that it states, and any damage is one `InputError`.
"""

from __future__ import annotations

import io
import math
import zipfile
import zlib
from collections.abc import Container, Iterable
from pathlib import Path

import numpy as np
from numpy.lib import format as npy_format

from carigs.errors import InputError
from carigs.readers.limits import MAX_ARRAY_BYTES, MAX_EXPANSION, max_unpacked_bytes, read_bytes, regular_file_size

MAX_ARRAYS = 10_000
KINDS = "biufSU"
"""Kinds of dtypes that are read: booleans, whole numbers, floating-point numbers and texts."""
MAX_DIMENSIONS = 8
NARROW, LARGEST_NUMBER = 4, 8
"""Bytes of a number: narrower ones count as the largest, because what uses them converts them."""
COMPRESSIONS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""What `numpy.savez` and `numpy.savez_compressed` write. Zlib stops at a given size, the others' libraries do not."""
_DAMAGE = (OSError, ValueError, EOFError, NotImplementedError, RuntimeError, zipfile.BadZipFile, zlib.error)
"""Exceptions of `zipfile`, `zlib` and `numpy.lib.format` for damaged files."""


def read_npz(
    file: str | Path,
    kind: str = "file",
    required: Iterable[str] = (),
    limit: int = MAX_ARRAY_BYTES,
    expansion: int = MAX_EXPANSION,
    only: Container[str] | None = None,
) -> dict[str, np.ndarray]:
    """Read all arrays of an .npz file.

    Args:
        file: The .npz file.
        kind: What the file is, for the message "no such {kind}".
        required: Names of arrays that must be present.
        limit: Largest sum of the arrays in bytes: a small file can hold gigabytes of zeros.
        expansion: Bytes of arrays for each byte of the file, see `max_unpacked_bytes`.
        only: Names of the arrays to read, where they are present; None for all.

    Returns:
        Arrays by name, each of one of `KINDS`.

    Raises:
        InputError: If the file is missing, is not an .npz file, is damaged, holds Python objects or two arrays of one
            name, exceeds a limit, or lacks a required array.
    """
    size = regular_file_size(file, kind)
    try:
        with zipfile.ZipFile(file) as archive:
            members, arrays, limit = archive.infolist(), {}, min(limit, max_unpacked_bytes(size, expansion))
            _check_members(members, file, limit)
            for member in members:
                if only is not None and member.filename[:-4] not in only:
                    continue
                array = arrays[member.filename[:-4]] = _read_member(archive, member, file)
                limit -= array.size * (array.itemsize if array.itemsize >= NARROW else LARGEST_NUMBER)
                if limit < 0:
                    raise InputError("more numbers than are read from a file of this size", file=file)
    except _DAMAGE as error:
        raise InputError(f"not a readable .npz ({error})", file=file) from error
    for name in required:
        if name not in arrays:
            raise InputError("this array is missing", file=file, field=name)
    return arrays


def read_npy(file: str | Path, kind: str = "file") -> np.ndarray:
    """Read an .npy file.

    Args:
        file: The .npy file.
        kind: What the file is, for the message "no such {kind}".

    Returns:
        The array, of one of `KINDS`.

    Raises:
        InputError: As for `read_npz`.
    """
    return _parse(read_bytes(file, MAX_ARRAY_BYTES, kind), file, None)


def is_possible_shape(shape: tuple[object, ...]) -> bool:
    """Whether an array of this shape can be worked with.

    Args:
        shape: What a file claims.

    Returns:
        Whether there are few dimensions, all whole numbers, and their product without zeros is not enormous: arrays
        without entries need no bytes in the file, but what is allocated from their lengths does.
    """
    if len(shape) > MAX_DIMENSIONS or not all(type(n) is int and n >= 0 for n in shape):
        return False
    return math.prod(max(n, 1) for n in shape) <= MAX_ARRAY_BYTES


def is_readable_text(array: np.ndarray) -> bool:
    """Whether the texts of an array can be read. NumPy checks no character before Python reads the text.

    Args:
        array: A row of any kind, contiguous.

    Returns:
        Whether it holds no texts, or only characters of Unicode (RFC 3629: up to U+10FFFF, without surrogates).
    """
    if array.dtype.kind != "U" or array.size == 0 or array.dtype.itemsize == 0:
        return True
    codes = array.view(np.dtype("u4").newbyteorder(array.dtype.byteorder))
    return bool(((codes < 0xD800) | ((codes > 0xDFFF) & (codes <= 0x10FFFF))).all())


def _check_members(members: list[zipfile.ZipInfo], file: str | Path, limit: int) -> None:
    """Refuse what would be slow, large or ambiguous, from the archive's directory alone."""
    if len(members) > MAX_ARRAYS:
        raise InputError(f"{len(members)} arrays; at most {MAX_ARRAYS} are read", file=file)
    total = sum(member.file_size for member in members)
    if total > limit:
        raise InputError(f"{total} bytes of arrays; at most {limit} are read", file=file)
    seen = set()
    for member in members:
        if not member.filename.endswith(".npy"):
            raise InputError("not an array (.npy)", file=file, field=member.filename)
        if member.compress_type not in COMPRESSIONS:
            raise InputError("compressed in another way than by NumPy", file=file, field=member.filename[:-4])
        if member.filename in seen:
            raise InputError("two arrays have this name", file=file, field=member.filename[:-4])
        seen.add(member.filename)


def _read_member(archive: zipfile.ZipFile, member: zipfile.ZipInfo, file: str | Path) -> np.ndarray:
    name = member.filename[:-4]
    try:
        with archive.open(member) as stream:
            content = stream.read(member.file_size)  # more is not unpacked; the checksum is compared at the end
    except _DAMAGE as error:
        raise InputError(f"not a readable .npz ({error})", file=file, field=name) from error
    return _parse(content, file, name)


def _parse(content: bytes, file: str | Path, name: str | None) -> np.ndarray:
    """The array of an .npy file's bytes."""
    stream = io.BytesIO(content)
    try:
        version = npy_format.read_magic(stream)
        if version == (1, 0):
            shape, fortran_order, dtype = npy_format.read_array_header_1_0(stream)
        elif version == (2, 0):
            shape, fortran_order, dtype = npy_format.read_array_header_2_0(stream)
        else:
            raise InputError(f"version {version[0]}.{version[1]} of .npy is unknown", file=file, field=name)
    except InputError:
        raise
    except Exception as error:  # NumPy evaluates the header as Python: many types
        raise InputError("the header of this array is damaged", file=file, field=name) from error
    if dtype.kind not in KINDS or dtype.subdtype is not None:
        raise InputError(f"holds {dtype}; numbers or texts are expected", file=file, field=name)
    if not is_possible_shape(shape):
        raise InputError(f"impossible shape {shape}", file=file, field=name)
    expected, found = math.prod(shape) * dtype.itemsize, len(content) - stream.tell()
    if expected != found or (dtype.itemsize == 0 and math.prod(shape) > MAX_ARRAYS):
        raise InputError(f"{found} bytes, its header claims {expected}", file=file, field=name)
    count = math.prod(shape)
    array = np.frombuffer(content, dtype, count, stream.tell()) if expected else np.zeros(count, dtype)
    if not is_readable_text(array):
        raise InputError("holds a text with a character that does not exist", file=file, field=name)
    return array.reshape(shape, order="F" if fortran_order else "C").copy()
