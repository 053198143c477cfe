"""All changes of a sound capture: damages, which must be noticed, and oddities, which must be accepted."""

from __future__ import annotations

from itertools import chain
from typing import NamedTuple

from stress.capture_changes import cameras, head_model, images, parameters
from stress.capture_changes.folder import Change
from stress.capture_changes.oddities import oddities


class Case(NamedTuple):
    """A change of a capture."""

    name: str
    change: Change
    is_damage: bool
    """Whether the change must be refused or warned of; else it must be accepted without a word."""


def cases() -> list[Case]:
    """All changes.

    Returns:
        Damages, then oddities.
    """
    damages = chain.from_iterable(kind.damages() for kind in (cameras, parameters, images, head_model))
    return [Case(*pair, True) for pair in damages] + [Case(*pair, False) for pair in oddities()]
