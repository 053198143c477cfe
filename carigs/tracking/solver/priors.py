"""What is known about a head that talks before its images are seen."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from carigs.fitting.fitted_parameters import FittedParameters
from carigs.fitting.objective import Prior
from carigs.head import HeadModel
from carigs.tracking.solver.objective import Shared

JOINTS = {"neck": 0.4, "jaw": 0.15, "left_eye": 1.0, "right_eye": 1.0}
"""Standard deviations of joints' rotations in radians. One landmark shows how an eye turns, so its prior is wide."""
OTHER_JOINTS = 0.3
SACCADE = 1.0
"""Standard deviation of the change of an eye's rotation, in radians from a frame to the next one: gaze jumps."""
EXPRESSION = 1.0
"""Standard deviation of expression coefficients."""
FRAME_RATE = 12.5
"""Frames per second that `Motion` refers to."""
LEAST_GAP = 1e-3
"""Of two frames' times, in frames of `FRAME_RATE`."""


@dataclass(frozen=True)
class Motion:
    """Standard deviations of changes from a frame to the next one, 1 / 12.5 s later: random walks."""

    translation: float = 0.02
    """Metres."""
    rotation: float = 0.05
    """Radians."""
    joints: float = 0.15
    """Radians."""
    expression: float = 0.3


def tracking_prior(
    model: HeadModel,
    fitted: FittedParameters,
    times: Float[np.ndarray, " t"],
    shared: Shared,
    motion: Motion,
    offset: Float[np.ndarray, " n"],
    focal: Float[np.ndarray, " l"],
) -> Prior:
    """Gaussian priors of frames, their changes, and what frames share.

    Args:
        model: The head model.
        fitted: The parameters of a frame.
        times: Of the frames, in seconds.
        shared: What frames share.
        motion: Changes from frame to frame.
        offset: Standard deviations of the offsets of landmarks and anchors in metres.
        focal: Standard deviation of the logarithm of each lens's focal length.

    Returns:
        The priors.
    """
    frames = np.zeros(fitted.frame_size)
    deviations = [JOINTS.get(model.joint_names[j], OTHER_JOINTS) for j in fitted.joints]
    frames[fitted.joint_slice] = np.repeat(deviations, 3) ** -2.0
    frames[fitted.expression_slice] = EXPRESSION**-2
    changes = np.empty(fitted.frame_size)
    parts = (slice(0, 3), slice(3, 6), fitted.joint_slice, fitted.expression_slice)
    of_parts = (motion.translation, motion.rotation, motion.joints, motion.expression)
    for part, deviation in zip(parts, of_parts, strict=True):
        changes[part] = deviation**-2
    jumping = [model.joint_names[j] in ("left_eye", "right_eye") for j in fitted.joints]
    changes[fitted.joint_slice][np.repeat(jumping, 3)] = SACCADE**-2
    gaps = np.maximum(np.diff(times) * FRAME_RATE, LEAST_GAP)
    precision = np.concatenate([np.ones(shared.shape), np.repeat(offset[: shared.points] ** -2.0, 3)])
    if shared.cameras:
        precision = np.concatenate([precision, focal**-2.0, np.zeros(shared.cameras - len(focal))])
    return Prior(frames, precision, changes / gaps[:, None])
