"""What users mean to be in a folder: not the files that systems and editors leave behind."""

from __future__ import annotations

import re
from pathlib import Path

SYSTEM_FILES = frozenset(
    {".ds_store", ".localized", "__macosx", "thumbs.db", "ehthumbs.db", "desktop.ini", "@eadir", "#recycle"}
    | {"$recycle.bin", "system volume information", "lost+found", ".ipynb_checkpoints"}
)
"""Names, in lower case, of what macOS, Windows, network disks, file systems and notebooks write without being asked."""
APPLE_DOUBLE = "._"
"""Start of the names of macOS' attributes of a file (._00000.png) on disks of other systems."""
PREFIXES, SUFFIXES = (".", "~$", ".#", "#"), ("~",)
"""Of names of hidden files, locks of office programs, and copies that editors keep (name~, #name#)."""


def is_system_file(name: str) -> bool:
    """Whether a system has written a file on its own account, so that nobody misses it.

    Args:
        name: Name of the file or folder, without folders above it.

    Returns:
        Whether it means nothing.
    """
    return name.startswith(APPLE_DOUBLE) or name.lower() in SYSTEM_FILES


def listed(folder: Path, pattern: str = "*") -> list[Path]:
    """List a folder of a user.

    Args:
        folder: The folder.
        pattern: Pattern of `Path.glob`; `**/*` for all that lies below.

    Returns:
        Files and folders in alphabetical order, without system files, hidden ones and copies of editors, and without
        what lies in such folders; nothing if there is no such folder.
    """
    return sorted(path for path in folder.glob(pattern) if not _is_unmeant(path, folder))


def _is_unmeant(path: Path, folder: Path) -> bool:
    """Whether a path is a system's or an editor's, or below such a folder. Editors keep copies of files alone."""
    *above, name = path.relative_to(folder).parts
    if not path.is_dir() and (name.startswith(PREFIXES) or name.endswith(SUFFIXES)):
        return True
    return any(is_system_file(part) or part.startswith(".") for part in (*above, name))


def natural_order(path: Path) -> tuple[list[str | int], str]:
    """Key by which names are sorted as people count: `a_9` before `a_30`.

    Args:
        path: A file.

    Returns:
        The parts of its name, numbers as numbers; equal ones are told apart by the name.
    """
    parts = re.split(r"([0-9]+)", path.name)  # every second part is a number
    return [int(part) if i % 2 else part for i, part in enumerate(parts)], path.name
