"""What is no file: folders, pipes, devices, links that lead nowhere, and a file of a terabyte without content."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from stress.hostile_cases.case import Case

SERVED = "download"
"""What a server sends."""
UNREAD = ("points3D.txt", "points3D.bin")
"""Files that readers leave alone."""
TERABYTE = 1 << 40


def _sparse(file: Path) -> None:
    file.touch()
    os.truncate(file, TERABYTE)


PLACES: dict[str, Callable[[Path], object]] = {
    "a folder": lambda file: file.mkdir(),
    "a pipe": lambda file: os.mkfifo(file),
    "a link to a device": lambda file: file.symlink_to("/dev/zero"),
    "a link to itself": lambda file: file.symlink_to(file),
    "a link to nothing": lambda file: file.symlink_to("nothing"),
    "a link to a folder": lambda file: file.symlink_to("/"),
    "a link to another file": lambda file: file.symlink_to("/etc/passwd"),
    "a terabyte without content": _sparse,
}


def not_files(sound: Mapping[str, bytes]) -> Iterator[Case]:
    """Everything else than a regular file in place of each reader's file.

    Args:
        sound: Content of a sound file of each reader.

    Yields:
        The cases.
    """
    for reader in filter(lambda reader: reader != SERVED, sound):
        for name, put in PLACES.items():
            may_be_absent = reader == "kept checksum" and name in ("a link to nothing", "a link to itself")
            yield Case(name, reader, put, must_fail=reader not in UNREAD and not may_be_absent)
