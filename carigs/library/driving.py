"""Head parameters of an avatar that follows a motion, and its capture as a motion."""

from __future__ import annotations

from typing import TYPE_CHECKING

from carigs.head import HeadModel, HeadParameters
from carigs.motion import Motion, Retargeting
from carigs.motion.retargeting import own_motion

if TYPE_CHECKING:
    from carigs.splat.rig.head_sequence import HeadSequence


def driven_parameters(sequence: HeadSequence, motion: Motion, driver: HeadModel | None = None) -> list[HeadParameters]:
    """Head parameters of a motion.

    Args:
        sequence: Head of the avatar, and its parameters over time; it is at rest at the first timestep.
        motion: The motion.
        driver: Head model that the motion belongs to, if names do not suffice.

    Returns:
        Parameters of every frame.

    Raises:
        SettingsError: If the motion cannot be transferred.
    """
    frames = [sequence.parameters[timestep] for timestep in sorted(sequence.parameters)]
    return Retargeting.to_frames(sequence.head, frames, driver)(motion)


def captured_motion(sequence: HeadSequence, fps: float) -> Motion:
    """The expressions and poses of a capture.

    Args:
        sequence: Head of the avatar, and its parameters over time.
        fps: Timesteps per second.

    Returns:
        The motion, at rest at the first timestep.
    """
    return own_motion(sequence.head, [sequence.parameters[t] for t in sorted(sequence.parameters)], fps)
