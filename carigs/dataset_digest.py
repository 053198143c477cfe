"""Has a dataset on disk changed? Names, sizes and times of its files tell, without reading images."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from hashlib import sha256
from pathlib import Path

from carigs.readers.limits import MAX_TEXT_BYTES

_FOLDER = re.compile(rb'"((?:[^"\\\n]{1,4000}/)?)[^"/\\\n]{1,300}\.(?:png|jpe?g|npz)"', re.IGNORECASE)
"""Paths of images and parameters in an index, with their folder as group."""


def dataset_digest(folder: str | Path, head_model: str | Path) -> str:
    """Digest of the names, sizes and modification times of a dataset's files.

    Args:
        folder: The dataset.
        head_model: Its head model.

    Returns:
        Hexadecimal digits. All files in the folders that the indexes name count; missing files are no error here.
    """
    folder = Path(folder)
    indexes = [folder / f"transforms_{split}.json" for split in ("train", "val", "test")]
    lines = {line for file in (*indexes, Path(head_model)) for line in _entry(file)}
    for part in sorted({part for file in indexes for part in _folders(file)}):
        lines.update(_entries(folder / os.fsdecode(part)))
    return sha256("\n".join(sorted(lines)).encode("utf-8", "surrogateescape")).hexdigest()[:32]


def _folders(index: Path) -> set[bytes]:
    """Folders of the files that an index names."""
    try:
        if index.stat().st_size > MAX_TEXT_BYTES:
            return set()
        return {match[1] for match in _FOLDER.finditer(index.read_bytes())}
    except OSError:
        return set()


def _entries(folder: Path) -> Iterator[str]:
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                if entry.is_file():
                    yield _line(entry.path, entry.stat())
    except (OSError, ValueError):
        return


def _entry(file: Path) -> Iterator[str]:
    try:
        yield _line(str(file), file.stat())
    except OSError:
        return


def _line(path: str, status: os.stat_result) -> str:
    return f"{path} {status.st_size} {status.st_mtime_ns}"
