"""Paths that users give: which cannot name a file or folder that anything is read from."""

from __future__ import annotations

import errno
import os
import stat
import unicodedata
from pathlib import Path

_KINDS = (
    (stat.S_ISREG, "a file"),
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a named pipe"),
    (stat.S_ISSOCK, "a socket"),
    (stat.S_ISCHR, "a device"),
    (stat.S_ISBLK, "a device"),
)


def path_problem(path: str) -> str:
    """Check a path before anything opens it; a file or folder of this name need not exist.

    Args:
        path: As a user gives it.

    Returns:
        What is wrong with it, for the end of a message that begins with the path; empty if nothing is. Refused are
        blanks alone, control characters, what is no text, names that are too long for the system, links that lead in a
        circle, `~`, which a shell alone replaces, and pipes, sockets and devices, which can be read without end.
    """
    if not path.strip():
        return "is blank; expected a file or a folder"
    categories = {unicodedata.category(character) for character in path}
    if "Cc" in categories:
        return "has a control character, such as a line break"
    if "Cs" in categories:
        return "is not text in UTF-8"
    try:
        mode = os.stat(path).st_mode
    except OSError as error:
        return _problem_without_file(path, error)
    kind = next((name for is_kind, name in _KINDS if is_kind(mode)), "of an unknown kind")
    return "" if kind in ("a file", "a folder") else f"is {kind}; expected a file or a folder"


def _problem_without_file(path: str, error: OSError) -> str:
    if error.errno == errno.ENAMETOOLONG:
        return f"is too long for a path ({len(os.fsencode(path))} bytes)"
    if error.errno == errno.ELOOP:
        return "is a link that leads in a circle"
    if path.startswith("~"):
        start, slash, rest = path.partition("/")
        return f"starts with {start}, which a shell alone replaces; type {Path(start).expanduser()}{slash}{rest}"
    return ""
