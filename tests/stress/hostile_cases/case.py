"""A file for a reader, and what is right for it."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple


class Case(NamedTuple):
    """A file for a reader."""

    name: str
    reader: str
    content: bytes | Callable[[Path], object]
    """Bytes of the file, or what puts something else in its place."""
    must_fail: bool = False
    """Whether only an error is right."""
    protected: bool = False
    """Whether what is read must equal what is read from the sound file."""
