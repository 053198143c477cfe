"""Errors that a user can cause. Every message says what is wrong, where, and what to do about it."""

from __future__ import annotations

from pathlib import Path


class CarigsError(Exception):
    """Base class of the errors caused by inputs or settings; printed as one line without a traceback."""

    def __init__(self, message: str) -> None:
        """Keep the message in one line.

        Args:
            message: The message. It may quote names from a file: characters that are not printable, such as line
                breaks, become escapes, and the middle of a message of more than 2000 characters is left out.
        """
        if len(message) > 2000:
            message = f"{message[:1000]} ... {message[-1000:]}"
        super().__init__("".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in message))


class CarigsWarning(UserWarning):
    """Something likely to be wrong, or left out: the work goes on, and the run repeats the line at its end."""


class InputError(CarigsError):
    """A file that cannot be used: missing, broken, of another shape, or with invalid values."""

    def __init__(self, problem: str, *, file: str | Path, field: str | None = None) -> None:
        """Compose the message `file: field: problem`.

        Args:
            problem: What is wrong.
            file: The file or folder.
            field: Array, key or position in the file.
        """
        self.problem, self.file, self.field = problem, str(file), field
        where = f"{self.file}: {field}" if field else self.file
        super().__init__(f"{where}: {problem}")


class SettingsError(CarigsError):
    """A setting with an unknown name, of the wrong type, or outside its range."""


class MeshError(CarigsError):
    """A mesh that no solver can use; the message names the vertex or face."""


class WeightsMissing(CarigsError):
    """Network weights that are not installed; the message names the file, where it was expected and its source."""
