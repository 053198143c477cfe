"""The errors a user can meet: each says what is wrong, in which file and field, and what to do."""

from __future__ import annotations

from pathlib import Path


class CarigsError(Exception):
    """Base of every error that is the input's or the settings' fault; printed as one line."""


class InputError(CarigsError):
    """A file that cannot be used: missing, broken, of another shape, or with values that make no sense."""

    def __init__(self, problem: str, *, file: str | Path, field: str | None = None) -> None:
        self.problem, self.file, self.field = problem, str(file), field
        where = f"{self.file}: {field}" if field else self.file
        super().__init__(f"{where}: {problem}")


class SettingsError(CarigsError):
    """A setting with an unknown name, of the wrong type, or outside its range."""


class MeshError(CarigsError):
    """A mesh that no solver can use; names the vertex or face."""


class WeightsMissing(CarigsError):
    """Network weights that are not on this machine: which file, where it was looked for, where to get it."""
