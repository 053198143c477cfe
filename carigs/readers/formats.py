"""The formats that carigs itself writes: `carigs-NAME-NUMBER`; the number grows when an older reader would be wrong."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from carigs.errors import InputError
from carigs.readers.arrays import checked_text

_FORMAT = re.compile("(carigs-[a-z]{1,30})-([0-9]{1,6})")


@dataclass(frozen=True)
class Format:
    """A format that this version of carigs reads and writes."""

    name: str
    """For example `carigs-avatar`."""
    number: int
    remedy: str
    """What makes a file of this format from one of an earlier version."""

    def __str__(self) -> str:
        return f"{self.name}-{self.number}"


def check_npz_format(
    arrays: Mapping[str, Any], expected: Format, file: str | Path, *, unstated: str | None = None
) -> None:
    """Check the format that an .npz file states in its text `format`.

    Args:
        arrays: The arrays of the file.
        expected: What is read.
        file: The file, for messages.
        unstated: Format of files that state none; None if all do.

    Raises:
        InputError: As for `check_format`.
    """
    try:
        found = checked_text(arrays, "format", file=file) if "format" in arrays else unstated
    except InputError as error:
        raise InputError(f"{error.problem}: not a {expected} file", file=file, field="format") from error
    check_format(found, expected, file)


def check_format(found: Any, expected: Format, file: str | Path, field: str = "format") -> None:
    """Check the format that a file states.

    Args:
        found: What the file states.
        expected: What is read.
        file: The file, for messages.
        field: Where it states it, for messages.

    Raises:
        InputError: If it is another format, or the same of an earlier or a later version; says which, and what to do.
    """
    match = _FORMAT.fullmatch(found) if isinstance(found, str) else None
    if match is None:
        problem = f"not a {expected} file"
    elif match[1] != expected.name:
        problem = f"not a {expected} file, but {found}"
    elif int(match[2]) < expected.number:
        problem = f"an earlier version of carigs wrote this file ({found}, expected {expected}): {expected.remedy}"
    elif int(match[2]) > expected.number:
        problem = f"a newer version of carigs wrote this file ({found}, this one reads {expected}): upgrade carigs"
    else:
        return
    raise InputError(problem, file=file, field=field)
