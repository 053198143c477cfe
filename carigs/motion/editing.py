"""Edits of a motion: frame rate, length, loops, smoothing, sides, neutral expression, strength of parts of the face."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation, Slerp

from carigs.errors import SettingsError
from carigs.motion.facial_actions import PARTS, actions, opposite, part
from carigs.motion.motion import FPS_RANGE, Motion
from carigs.motion.one_euro import one_euro

HEAD_AXES = {"pitch": 0, "yaw": 1, "roll": 2}
"""Components of a rotation vector: nodding, turning, tilting."""
STRENGTHS = (*dict.fromkeys(PARTS.values()), "gaze", "head", *HEAD_AXES)
"""What `strengthened` can change."""
EYES = ("left_eye", "right_eye")
BLEND_SECONDS = 0.4
"""Length of the transition from the end of a loop to its start."""


def resampled(motion: Motion, fps: float) -> Motion:
    """Change the frame rate: numbers are interpolated linearly, rotations along the shortest arc.

    Args:
        motion: The motion.
        fps: Frames per second.

    Returns:
        The motion from the first to the last frame, at times k / fps.

    Raises:
        SettingsError: If the rate is out of range.
    """
    if fps == motion.fps:
        return motion
    if not FPS_RANGE[0] <= fps <= FPS_RANGE[1]:  # also refuses NaN
        raise SettingsError(f"motion: {fps:g} frames per second; expected {FPS_RANGE[0]:g} to {FPS_RANGE[1]:g}")
    last = (len(motion) - 1) / motion.fps
    times = np.arange(int(np.floor(last * fps * (1 + 1e-12) + 1e-9)) + 1) / fps
    return at_times(motion, np.minimum(times, last) * motion.fps, fps)


def at_times(motion: Motion, places: Float[np.ndarray, " n"], fps: float) -> Motion:
    """Evaluate a motion between its frames.

    Args:
        motion: The motion.
        places: Numbers of frames with fractions, from 0 to the last one.
        fps: Frames per second of the result.

    Returns:
        The motion at these places.
    """
    known = np.arange(len(motion), dtype=np.float64)
    columns = {}
    for name, array in motion.columns().items():
        if name.startswith("joint ") or name == "rotation":
            columns[name] = _between(array, places)
        else:
            columns[name] = np.stack([np.interp(places, known, column) for column in array.T], axis=1).reshape(
                len(places), array.shape[1]
            )
    return motion.with_columns(columns, fps)


def _between(vectors: Float[np.ndarray, "t 3"], places: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3"]:
    """Rotation vectors between given ones; at the given ones they are the same numbers."""
    whole = np.rint(places).astype(np.int64)
    is_given = np.abs(places - whole) < 1e-9
    if len(vectors) == 1 or not vectors.any():
        return vectors[np.minimum(whole, len(vectors) - 1)]
    found = Slerp(np.arange(len(vectors)), Rotation.from_rotvec(vectors))(places).as_rotvec()
    return np.where(is_given[:, None], vectors[whole], found)


def smoothed(motion: Motion, cut_off: float = 1.5, slope: float = 3.0) -> Motion:
    """Smooth by the one-euro filter, which lets fast changes such as blinks pass.

    Args:
        motion: The motion.
        cut_off: Cut-off of what rests, in hertz; lower smooths more.
        slope: Growth of the cut-off with the speed.

    Returns:
        The motion, whose rotations are those of smoothed rotation vectors.
    """
    columns = {name: one_euro(array, motion.fps, cut_off, slope) for name, array in motion.columns().items()}
    return motion.with_columns(columns)


def trimmed(motion: Motion, start: float = 0.0, end: float | None = None) -> Motion:
    """Keep the frames from one time to another.

    Args:
        motion: The motion.
        start: Seconds.
        end: Seconds; None for the end. The frame at this time is not kept.

    Returns:
        The motion.

    Raises:
        SettingsError: If there is no frame between.
    """
    first = max(int(np.ceil(start * motion.fps - 1e-9)), 0)
    last = len(motion) if end is None else min(int(np.ceil(end * motion.fps - 1e-9)), len(motion))
    if first >= last:
        raise SettingsError(f"motion: no frame from {start:g} s to {motion.seconds if end is None else end:g} s")
    return motion.frames(np.arange(first, last))


def looped(motion: Motion, seconds: float) -> Motion:
    """Repeat a motion until it has a length; its end moves smoothly to its start.

    Args:
        motion: The motion.
        seconds: Length of the result.

    Returns:
        The motion. One that is longer already is cut.
    """
    count = max(round(seconds * motion.fps), 1)
    if count <= len(motion):
        return motion.frames(np.arange(count))
    blend = min(round(BLEND_SECONDS * motion.fps), len(motion) // 2)
    period = len(motion) - blend
    looping = motion.frames(np.arange(period))
    if blend:  # the frames behind the period fade into those at its start
        share = (np.arange(1, blend + 1) / (blend + 1))[:, None]
        columns = {}
        for name, array in motion.columns().items():
            mixed = (1 - share) * array[period:] + share * array[:blend]
            columns[name] = np.concatenate([mixed, array[blend:period]])
        looping = motion.with_columns(columns)
    first = motion.frames(np.arange(min(period, count)))
    rest = np.arange(count - len(first)) % period
    columns = {name: np.concatenate([array, looping.columns()[name][rest]]) for name, array in first.columns().items()}
    return motion.with_columns(columns)


def mirrored(motion: Motion) -> Motion:
    """Exchange left and right, as a mirror shows the motion.

    Args:
        motion: The motion.

    Returns:
        The motion; mirrored twice it is the same.

    Raises:
        SettingsError: If expressions have no names that say which side they move.
    """
    by_actions = {actions(name): place for place, name in enumerate(motion.names)}
    order, unknown = [], []
    for place, name in enumerate(motion.names):
        found = by_actions.get(frozenset(map(opposite, actions(name)))) if actions(name) else None
        if found is None and motion.expression[:, place].any():
            unknown.append(name)
        order.append(place if found is None else found)
    if unknown:
        raise SettingsError(f"motion: {', '.join(unknown[:5])} cannot be mirrored: no names of both sides are known")
    turned, moved = np.array([1.0, -1.0, -1.0]), np.array([-1.0, 1.0, 1.0])
    joints = {_other_side(name): turned * rotations for name, rotations in motion.joints.items()}
    return replace(
        motion, expression=motion.expression[:, order], joints=joints, rotation=turned * motion.rotation,
        translation=moved * motion.translation, rest_rotation=turned * motion.rest_rotation,
        rest_translation=moved * motion.rest_translation,
    )  # fmt: skip


def _other_side(joint: str) -> str:
    for side, other in (("left_", "right_"), ("right_", "left_")):
        if joint.startswith(side):
            return other + joint.removeprefix(side)
    return joint


def neutralised(motion: Motion, seconds: float) -> Motion:
    """Take the driver's expression and pose at a time for the neutral ones.

    Args:
        motion: The motion.
        seconds: When the driver's face rests and looks straight ahead.

    Returns:
        The motion without this expression, and relative to this pose. Coefficients of named expressions stay at least
        0.
    """
    at = min(max(round(seconds * motion.fps), 0), len(motion) - 1)
    named = np.array([bool(actions(name)) for name in motion.names], bool)
    expression = motion.expression - motion.expression[at]
    expression = np.where(named & (motion.expression >= 0), np.maximum(expression, 0), expression)
    joints = {
        name: (Rotation.from_rotvec(rotations) * Rotation.from_rotvec(rotations[at]).inv()).as_rotvec()
        for name, rotations in motion.joints.items()
    }
    return replace(
        motion, expression=expression, joints=joints, rest_rotation=motion.rotation[at],
        rest_translation=motion.translation[at],
    )  # fmt: skip


def strengthened(motion: Motion, strengths: Mapping[str, float]) -> Motion:
    """Multiply the motion of parts of the face.

    Args:
        motion: The motion.
        strengths: Factors by `STRENGTHS`. `gaze` turns the eyes; `head` is all motion of head and neck, `pitch`, `yaw`
            and `roll` are its rotations.

    Returns:
        The motion.

    Raises:
        SettingsError: If a name is unknown or a factor not finite.
    """
    for name, factor in strengths.items():
        if name not in STRENGTHS or not np.isfinite(factor):
            raise SettingsError(f"{name}={factor:g}: expected a number for one of {', '.join(STRENGTHS)}")
    factors = np.array([strengths.get(part(name), 1.0) for name in motion.names])
    head = strengths.get("head", 1.0)
    turns = head * np.array([strengths.get(name, 1.0) for name in HEAD_AXES])
    by_joint = {"neck": turns, "jaw": strengths.get("jaw", 1.0)} | dict.fromkeys(EYES, strengths.get("gaze", 1.0))
    rest = Rotation.from_rotvec(motion.rest_rotation)
    rotation = motion.rotation
    if (turns != 1).any():  # of what turns the head from its rest
        rotation = (
            rest * Rotation.from_rotvec(turns * (rest.inv() * Rotation.from_rotvec(rotation)).as_rotvec())
        ).as_rotvec()
    return replace(
        motion, expression=motion.expression * factors,
        joints={name: rotations * by_joint.get(name, 1.0) for name, rotations in motion.joints.items()},
        rotation=rotation,
        translation=head * motion.translation + (1 - head) * motion.rest_translation,
    )  # fmt: skip
