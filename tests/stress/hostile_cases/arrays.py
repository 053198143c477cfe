"""Files of arrays: wrong arrays of .npz files, and headers with false sizes."""

from __future__ import annotations

import io
import warnings
import zipfile
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from stress.hostile_cases.case import Case

FREE_LENGTH = ("report", "name", "names")
INDICES = ("faces", "triangles", "f", "binding", "columns", "mask_nose", "kintree_table")


def wrong_arrays(reader: str, content: bytes, *, is_strict: bool = True) -> Iterator[Case]:
    """Each array of an .npz file changed or left out.

    Args:
        reader: The reader.
        content: A sound file of it.
        is_strict: Whether the reader accepts no other shapes and no values that are not finite. (The confidence of a
            landmark may be NaN, for example.)

    Yields:
        The cases.
    """
    with np.load(io.BytesIO(content)) as archive:
        sound = dict(archive)
    for name, array in sound.items():
        if name in ("format", "rig") or name.endswith(FREE_LENGTH):
            continue
        changes: dict[str, tuple[Any, bool]] = {
            "a text": (np.full(array.shape, "x"), array.size > 0),
            "complex": (array.astype(complex) * 1j, array.size > 0),
            "objects": (np.array([None, {}], object), True),
            "8 dimensions": (np.zeros((1,) * 8), False),
            "empty": (np.zeros(0, array.dtype), array.size > 0 and not name.endswith("nose")),
            "a column less": (
                array[..., :-1] if array.ndim > 1 else array[None],
                array.ndim != 1 and array.size > 0 and name not in ("shapedirs", "expr"),  # fewer coefficients
            ),
            "as float16": (np.nan_to_num(array.astype(np.float16)), False),
            "all 1e38": (np.full(array.shape, 1e38), False),
            "all 1e-300": (np.full(array.shape, 1e-300), False),
        }
        if array.dtype.kind == "f" and array.size:
            for value in (np.nan, np.inf):
                changed = array.copy()
                changed[(-1,) * array.ndim] = value
                changes[f"one {value}"] = changed, True
        if array.dtype.kind in "iu" and name.endswith(INDICES) and array.size:
            for value in (-2, 2**31 - 1, 2**32, 2**62):
                changed = array.astype(np.int64)
                changed[(0, -1) if array.ndim > 1 else -1] = value
                changes[f"index {value}"] = changed, True
        for change, (value, must_fail) in changes.items():
            stream = io.BytesIO()
            np.savez(stream, **{**sound, name: value})
            optional = name in ("landmarks68", "expression_names")
            yield Case(
                f"{name}: {change}", reader, stream.getvalue(), must_fail=must_fail and is_strict and not optional
            )
        stream = io.BytesIO()
        np.savez(stream, **{key: value for key, value in sound.items() if key != name})
        yield Case(f"{name}: missing", reader, stream.getvalue())


def false_headers() -> Iterator[Case]:
    """Headers of .npy files with false sizes or code, and an archive that is small when packed.

    Yields:
        The cases.
    """
    for shape, dtype in (
        ((10**12,), "<f8"), ((2**62, 4), "<f8"), ((-1,), "<f8"), ((3,), "O"), ((10**12,), "<U0"), ((0,), "<c16"),
        ((3,), "<M8[s]"), ((1,), "V8"), ((1,) * 40, "<f8"), ((10**9, 10**9, 0), "<f8"),
    ):  # fmt: skip
        header = f"{{'descr': '{dtype}', 'fortran_order': False, 'shape': {shape}, }}".ljust(245) + "\n"
        content = b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header.encode()
        yield Case(f"claims {shape[:3]} {dtype}", "npy", content, must_fail=dtype != "<f8" or 0 not in shape)
    for text in ("__import__('os').system('touch ran')", "{}" * 9, "(" * 5000, "{'shape': 10**10**10}"):
        content = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text.encode()
        yield Case(f"header {text[:30]}", "npy", content, must_fail=True)
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("v.npy", bytes(200 << 20))
    yield Case("200 MB of zeros", "npz", stream.getvalue(), must_fail=True)
    header = b"\x93NUMPY\x01\x00\xf6\x00" + b"{'descr': '|u1', 'fortran_order': False, 'shape': (629145600,), }"
    yield Case("600 MB of zeros in 600 KB", "npz", _packed(header.ljust(255) + b"\n", 600 << 20), must_fail=True)
    for method in (zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA):
        content = _packed(b"", 100 << 20, method)
        size = (500).to_bytes(4, "little")
        listed = content.rindex(b"PK\x01\x02")
        content = content[:22] + size + content[26 : listed + 24] + size + content[listed + 28 :]
        yield Case(f"100 MB said to be 500 bytes ({method})", "npz", content, must_fail=True)
    for shape in ((2**40, 0), (0, 2**62), (2**31, 0, 2**31)):
        text = f"{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}".ljust(245).encode() + b"\n"
        yield Case(f"no entries in {shape}", "npy", b"\x93NUMPY\x01\x00\xf6\x00" + text, must_fail=True)
    stream = io.BytesIO()
    with warnings.catch_warnings(), zipfile.ZipFile(stream, "w") as archive:
        warnings.simplefilter("ignore", UserWarning)  # that a name is there already
        for value in (1.0, 2.0):
            npy = io.BytesIO()
            np.save(npy, value)
            archive.writestr("v.npy", npy.getvalue())
    yield Case("two members of one name", "npz", stream.getvalue(), must_fail=True)


def _packed(start: bytes, zeros: int, method: int = zipfile.ZIP_DEFLATED) -> bytes:
    """An archive with one member that ends with zeros, as many as a multiple of a megabyte."""
    stream = io.BytesIO()
    with (
        zipfile.ZipFile(stream, "w", method) as archive,
        archive.open("v.npy", "w", force_zip64=False) as member,
    ):
        member.write(start)
        for _ in range(zeros >> 20):
            member.write(bytes(1 << 20))
    return stream.getvalue()


def false_header_lengths(sound: Mapping[str, bytes]) -> Iterator[Case]:
    """Files of safetensors with a false length of the header.

    Args:
        sound: Content of a sound file of each reader.

    Yields:
        The cases.
    """
    for length in (0, 2**40, 2**63 - 1, 7):
        content = length.to_bytes(8, "little") + sound["safetensors"][8:]
        yield Case(f"header of {length} bytes", "safetensors", content, must_fail=True)
