"""Paths in the indexes of datasets: a dataset names its own files, and those of the sequences beside it."""

from __future__ import annotations

import os
from pathlib import Path, PureWindowsPath

from carigs.errors import InputError
from carigs.readers.file_names import with_slashes


def file_inside(name: str, index: Path, field: str) -> str:
    """Refuse paths that lead elsewhere: their files would be copied into results.

    Folders that lie elsewhere can be linked: links are followed.

    Args:
        name: Path, relative to the folder of the index.
        index: The index, for messages.
        field: Its field, for messages.

    Returns:
        The path, with slashes between its folders.

    Raises:
        InputError: If the path is absolute, or leaves both the folder of the index and the folders beside it, which
            union folders refer to.
    """
    path = with_slashes(name, index.parent)
    if not path or PureWindowsPath(path).anchor or os.path.normpath(path).startswith(os.path.join("..", "..")):
        problem = f"{name[:100]!r} is no path inside the dataset's folder or a folder beside it"
        raise InputError(f"{problem}; link folders that lie elsewhere", file=index, field=field)
    return path
