"""Sizes and SHA-256 checksums of files."""

from __future__ import annotations

import hashlib
from functools import cache
from pathlib import Path

from carigs.errors import InputError
from carigs.readers.limits import read_bytes
from carigs.system.files import writing


def check_file(path: Path, title: str, *, size: int | None, sha256: str, remedy: str) -> str:
    """Compare a file with what is known of it: its size, and its checksum or the one that was kept of its download.

    Args:
        path: The file.
        title: What it should be, for the error message.
        size: Bytes; None if unknown.
        sha256: Checksum or its beginning; empty if unknown.
        remedy: What to do about a wrong file, for the error message.

    Returns:
        What was compared: `sha256`, `sha256 of the download`, `size`, or an empty text if nothing is known.

    Raises:
        InputError: Size or checksum differ.
    """
    actual_size = path.stat().st_size
    if size not in (None, actual_size):
        problem = f"{actual_size} bytes, {title} has {size}: it is incomplete or another file; {remedy}"
        raise InputError(problem, file=path)
    compared, kept = "sha256", _kept_in(path)
    if not sha256 and kept.is_file():
        content = read_bytes(kept, 1000, "file with a checksum").decode("ascii", "replace")
        compared, sha256 = "sha256 of the download", (content.split() or ["nothing"])[0]
    if not sha256:
        return "" if size is None else "size"
    actual = file_checksum(path)
    if not actual.startswith(sha256.lower()):
        problem = f"sha256 begins with {actual[:12]}, {title} has {sha256[:12]}: it is damaged or another file"
        raise InputError(f"{problem}; {remedy}", file=path)
    return compared


def file_checksum(path: Path) -> str:
    """SHA-256 of a file. It is read once as long as its size and time stay the same.

    Args:
        path: The file.

    Returns:
        64 hexadecimal digits.
    """
    status = path.stat()
    return _checksum(path, status.st_size, status.st_mtime_ns)


def keep_checksum(path: Path, sha256: str) -> None:
    """Write the checksum of a file beside it, as `{path}.sha256` in the format of `sha256sum`.

    Args:
        path: The file.
        sha256: Its checksum.
    """
    with writing(_kept_in(path)) as part:
        part.write_text(f"{sha256}  {path.name}\n")


def _kept_in(path: Path) -> Path:
    return path.with_name(f"{path.name}.sha256")


@cache
def _checksum(path: Path, size: int, modified: int) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()
