"""Rotations of joints, and the rigid transforms along a kinematic chain."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int


def rotation_matrices(rotation_vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3 3"]:
    """Rodrigues' formula: R = I + sin(a)/a K + (1 - cos a)/a^2 K^2 with the cross product matrix K of the vector.

    Args:
        rotation_vectors: Axes times angles a, in radians.

    Returns:
        Rotation matrices; exact in the limit of a vanishing vector.
    """
    x, y, z = np.moveaxis(rotation_vectors, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*rotation_vectors.shape, 3)
    angle = np.sqrt(x * x + y * y + z * z)[..., None, None]
    # sin(a)/a and (1 - cos a)/a^2 by sinc, which is smooth at 0.
    first, second = np.sinc(angle / np.pi), 0.5 * np.sinc(angle / (2 * np.pi)) ** 2
    return np.eye(3) + first * cross + second * cross @ cross


def joint_transforms(
    rotations: Float[np.ndarray, "t j 3 3"], joints: Float[np.ndarray, "t j 3"], parents: Int[np.ndarray, " j"]
) -> Float[np.ndarray, "t j 3 4"]:
    """Rigid transforms of the joints along their kinematic chain.

    Args:
        rotations: Rotations of the joints relative to their parents.
        joints: Positions of the joints at rest, in metres.
        parents: Parent of every joint, before it in the order; -1 for the root.

    Returns:
        world_from_rest [R | t] of every joint.
    """
    world_from_rest = np.zeros((*joints.shape, 4))
    for j, parent in enumerate(parents):
        rotation, position = rotations[:, j], joints[:, j, :, None]
        if parent >= 0:
            above = world_from_rest[:, parent]
            rotation, position = above[:, :, :3] @ rotation, above[:, :, :3] @ position + above[:, :, 3:]
        world_from_rest[:, j, :, :3] = rotation
        world_from_rest[:, j, :, 3:] = position - rotation @ joints[:, j, :, None]
    return world_from_rest
