"""Digests of what files and folders contain, and of what a file system says of them without reading them."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from hashlib import file_digest, sha256
from pathlib import Path
from typing import TypedDict

SECONDS_UNTIL_TOUCHED = 5
"""Snakemake sets the modification time of an output anew when its job has ended."""


class Contents(TypedDict):
    """What a job has written into a file or folder."""

    digest: str
    """Of the contents (`content_digest`)."""
    state: str
    """Of sizes and modification times (`file_state`)."""


def contents_of(path: Path) -> Contents:
    """Describe a file or folder.

    Args:
        path: The file or folder.

    Returns:
        What `is_unchanged` compares.
    """
    return Contents(digest=content_digest(path), state=file_state(path))


def is_unchanged(path: Path, before: Contents) -> bool:
    """Whether a file or folder is what it was. Contents are read where size and modification time do not tell.

    Args:
        path: The file or folder.
        before: What it was.

    Returns:
        True also if it is not there: Snakemake makes it again if another job needs it.
    """
    if not path.exists() or (state := file_state(path)) == before["state"]:
        return True
    numbers = re.fullmatch(r"(\d+) (\d+)", before["state"])
    if numbers and path.is_file():
        (size, modified), (size_before, written) = map(int, state.split()), map(int, numbers.groups())
        if size == size_before and 0 <= modified - written <= SECONDS_UNTIL_TOUCHED * 10**9:
            return True
    return content_digest(path) == before["digest"]


def content_digest(path: Path) -> str:
    """Digest of a file, or of the names and contents of all files below a folder, without hidden ones.

    Args:
        path: The file or folder.

    Returns:
        Hexadecimal digits; empty if there is nothing of this name.
    """
    if not path.is_dir():
        if not path.is_file():
            return ""
        with path.open("rb") as stream:
            return file_digest(stream, "sha256").hexdigest()[:32]
    lines = (f"{name} {content_digest(path / name)}" for name, _ in _files_below(path))
    return text_digest("\n".join(lines))


def text_digest(text: str) -> str:
    """Digest of a text; that of a file with this text is the same.

    Args:
        text: The text.

    Returns:
        Hexadecimal digits.
    """
    return sha256(text.encode()).hexdigest()[:32]


def file_state(path: Path) -> str:
    """Digest of the sizes and modification times of a file, or of all files below a folder with their names.

    While it stays the same, the contents stay the same, unless somebody sets modification times on purpose.

    Args:
        path: The file or folder.

    Returns:
        For a file its size in bytes and its modification time in nanoseconds, else hexadecimal digits. Empty if there
        is nothing of this name.
    """
    if not path.is_dir():
        return _state(path.stat()) if path.is_file() else ""
    return text_digest("\n".join(f"{name} {_state(status)}" for name, status in _files_below(path)))


def _files_below(folder: Path) -> Iterator[tuple[str, os.stat_result]]:
    """Names and states of all files below a folder, sorted, without hidden ones: Snakemake writes some of its own."""
    found = []
    for directory, _, files in os.walk(folder):
        for name in files:
            path = os.path.join(directory, name)
            if not name.startswith(".") and os.path.isfile(path):
                found.append((Path(path).relative_to(folder).as_posix(), os.stat(path)))
    yield from sorted(found)


def _state(status: os.stat_result) -> str:
    return f"{status.st_size} {status.st_mtime_ns}"
