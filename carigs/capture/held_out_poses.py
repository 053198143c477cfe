"""How far the head poses of held-out frames lie from those of training frames.

An avatar answers for what training frames showed. Errors of test frames whose head is turned as in no training frame
are those of an extrapolation.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from carigs.capture.camera import Camera
from carigs.capture.dataset import Capture
from carigs.head import HeadModel, HeadParameters
from carigs.head.joint_transforms import joint_transforms, rotation_matrices

TOWARDS_CAMERA = np.diag([1.0, -1.0, -1.0])
"""From OpenCV camera axes to those of a head that looks into the camera: x to its left, y up, z forward."""
MARGIN = 1.0
"""Degrees beyond the angles of all training frames from which a test frame lies outside: as much as trackers err."""
BLOCK = 256
"""Test frames that are compared with all training frames at a time."""


class PoseGap(NamedTuple):
    """How the head poses of test frames lie to those of training frames."""

    tested: int
    trained: int
    outside: float
    """Share of the test frames with a yaw, pitch or roll that no training frame reaches."""
    median: float
    """Degrees by which the head of a test frame is turned against that of the nearest training frame."""
    largest: float

    def __str__(self) -> str:
        return (
            f"head poses of {self.tested} test frames: {100 * self.outside:.0f} % lie outside of the yaw, pitch or "
            f"roll of the {self.trained} training frames; the nearest training frame is {self.median:.1f} degrees away "
            f"in the median, {self.largest:.1f} at most"
        )


def pose_gap(train: Float[np.ndarray, "n 3 3"], test: Float[np.ndarray, "m 3 3"]) -> PoseGap:
    """Compare the head poses of test frames with those of training frames.

    Args:
        train: Rotations of the head in training frames, against the camera (`facing`).
        test: The same in test frames.

    Returns:
        How far they lie apart. The angle between two poses is that of the rotation from one to the other.
    """
    known, asked = turn_angles(train), turn_angles(test)
    beyond = (asked < known.min(axis=0) - MARGIN) | (asked > known.max(axis=0) + MARGIN)
    flat = train.reshape(len(train), 9).T
    nearest = np.empty(len(test))
    for first in range(0, len(test), BLOCK):
        part = slice(first, first + BLOCK)
        # |A - B|^2 = 6 - 2 tr(A^T B) = 8 sin^2(angle / 2)
        distance = np.maximum(6 - 2 * (test[part].reshape(-1, 9) @ flat).max(axis=1), 0)
        nearest[part] = 2 * np.degrees(np.arcsin(np.minimum(np.sqrt(distance / 8), 1)))
    share = float(beyond.any(axis=1).mean())
    return PoseGap(len(test), len(train), share, float(np.median(nearest)), float(nearest.max()))


def turn_angles(turns: Float[np.ndarray, "n 3 3"]) -> Float[np.ndarray, "n 3"]:
    """Yaw, pitch and roll of heads.

    Args:
        turns: Rotations R = R_y(yaw) R_x(pitch) R_z(roll) of heads against the camera (`facing`).

    Returns:
        Degrees: yaw to the person's left, pitch down, roll of the crown to the person's right.
    """
    yaw = np.arctan2(turns[:, 0, 2], turns[:, 2, 2])
    pitch = -np.arcsin(turns[:, 1, 2].clip(-1, 1))
    roll = np.arctan2(turns[:, 1, 0], turns[:, 1, 1])
    return np.degrees(np.stack([yaw, pitch, roll], axis=1))


def facing(
    model: HeadModel, parameters: Sequence[HeadParameters], cameras: Sequence[Camera]
) -> Float[np.ndarray, "n 3 3"]:
    """Rotations of heads against the line of sight of the cameras that see them.

    Args:
        model: The head model.
        parameters: Head parameters of each frame.
        cameras: The camera of each frame.

    Returns:
        The identity for a head that looks into the camera, wherever it is in the image. The skull counts: the neck
        turns it, the jaw does not.
    """
    rotations, middles = _skulls(model, parameters)
    matrices = np.array([camera.camera_from_world for camera in cameras])
    seen = np.einsum("nij,nj->ni", matrices[:, :3, :3], middles) + matrices[:, :3, 3]
    seen /= np.linalg.norm(seen, axis=1, keepdims=True)
    # The smallest rotation that takes the direction to the head to the optical axis.
    axes = np.cross(seen, [0.0, 0.0, 1.0])
    sines = np.linalg.norm(axes, axis=1, keepdims=True)
    angles = np.arctan2(sines, seen[:, 2:])
    centred = rotation_matrices(axes * angles / np.maximum(sines, 1e-12))
    return TOWARDS_CAMERA @ centred @ matrices[:, :3, :3] @ rotations


def _skulls(
    model: HeadModel, parameters: Sequence[HeadParameters]
) -> tuple[Float[np.ndarray, "n 3 3"], Float[np.ndarray, "n 3"]]:
    """Rotation of the skull, and its middle in the world: means over the upper half of the template by its weights."""
    upper = model.v_template[:, 1] > np.median(model.v_template[:, 1])
    weights, rest = model.weights[upper].astype(np.float64), model.v_template[upper].astype(np.float64)
    turns = rotation_matrices(np.array([[frame.rotation, *frame.joints] for frame in parameters]))
    joints = np.broadcast_to(model.joint_template, (len(turns), *model.joint_template.shape))
    world_from_rest = joint_transforms(turns, joints, model.parents)
    rotated, shift = world_from_rest[..., :3], world_from_rest[..., 3]
    middles = np.einsum("njab,jb->na", rotated, weights.T @ rest / len(rest)) + np.einsum(
        "nja,j->na", shift, weights.mean(axis=0)
    )
    middles += np.array([frame.translation for frame in parameters])
    u, _, vt = np.linalg.svd(np.einsum("njab,j->nab", rotated, weights.mean(axis=0)))
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    return u @ vt, middles


def capture_pose_gap(capture: Capture) -> PoseGap | None:
    """Compare the head poses of a capture's test frames with those of its training frames.

    Args:
        capture: The capture.

    Returns:
        How far they lie apart; None without frames of both kinds.

    Raises:
        InputError: If head parameters cannot be read.
    """
    splits = [capture.split(name) for name in ("train", "test")]
    if not all(splits):
        return None
    timesteps = sorted({frame.timestep for split in splits for frame in split})
    # Offsets of all timesteps of a large capture would be gigabytes.
    parameters = {t: replace(capture.parameters(t), static_offset=None, dynamic_offset=None) for t in timesteps}
    train, test = (
        facing(capture.model, [parameters[f.timestep] for f in frames], [capture.camera(f) for f in frames])
        for frames in splits
    )
    return pose_gap(train, test)
