"""Motions that a page can show instead of the capture."""

from __future__ import annotations

import contextlib
import warnings
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from carigs.errors import CarigsError, CarigsWarning
from carigs.head import HeadModel, HeadParameters
from carigs.library import HeadAvatar
from carigs.library.driving import driven_parameters
from carigs.motion import BUILT_IN, Motion

CAPTURED = "as captured"
"""Name of no motion."""


class Drive(NamedTuple):
    """A motion of an avatar."""

    name: str
    fps: float
    parameters: Sequence[HeadParameters]


def drives_of(avatar: HeadAvatar, motions: Mapping[str, Motion], driver: HeadModel | None = None) -> tuple[Drive, ...]:
    """Transfer motions to an avatar, and the built-in ones behind them.

    Args:
        avatar: The avatar.
        motions: Motions by name.
        driver: Head model that they belong to, if names do not suffice.

    Returns:
        The motions of the avatar.

    Raises:
        SettingsError: If one of the given ones cannot be transferred.
    """
    sequence = avatar.avatar.sequence
    drives = [Drive(name, motion.fps, driven_parameters(sequence, motion, driver)) for name, motion in motions.items()]
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", CarigsWarning)  # nobody chose them
        for name, make in BUILT_IN.items():
            motion = make()
            with contextlib.suppress(CarigsError):  # a head that cannot do what nobody has asked for
                if name not in motions:
                    drives.append(Drive(name, motion.fps, driven_parameters(sequence, motion)))
    return tuple(drives)
