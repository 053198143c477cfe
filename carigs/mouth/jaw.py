"""The two jaws, by number."""

from enum import IntEnum


class Jaw(IntEnum):
    """What a triangle moves with."""

    NONE = 0
    UPPER = 1
    """The skull."""
    LOWER = 2
    """The jaw."""
