"""Splats in world coordinates, baked from the rig at one timestep and level: what viewers without a rig read."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Float32, Float64
from scipy.spatial.transform import Rotation

from carigs.splat.avatar import Avatar
from carigs.splat.colour.harmonics_rotation import rotate_harmonics
from carigs.splat.colour.spherical_harmonics import SH_BASE
from carigs.splat.rig.blended_rotation import blended_rotations
from carigs.splat.rig.face_motion import FaceMotion
from carigs.splat.rig.similarity_motion import similarity_motion
from carigs.splat.rig.skinning import jacobian_blend_skinning
from carigs.splat.surfels.surfels import to_arrays

MIN_SCALE = 1e-9
"""Smallest standard deviation in metres: files store logarithms."""
MIN_OPACITY = 1e-6
"""Smallest distance of an opacity from 0 and 1: files store logits."""


class WorldSplats(NamedTuple):
    """Flat Gaussians in world coordinates (metres), y up and the face towards +z for an avatar at rest."""

    centre: Float64[np.ndarray, "n 3"]
    rotation: Float64[np.ndarray, "n 4"]
    """Unit quaternion wxyz; the third axis is the normal."""
    scale: Float64[np.ndarray, "n 2"]
    """Standard deviations along the first two axes in metres, the larger one first."""
    opacity: Float64[np.ndarray, " n"]
    """In (0, 1)."""
    colour: Float64[np.ndarray, "n 3"]
    """Spherical harmonic of degree 0: RGB = 0.5 + SH_BASE * colour."""
    harmonics: Float64[np.ndarray, "n k 3"]
    """Higher degrees, for view directions in world axes."""


def bake(avatar: Avatar, timestep: int, level: float) -> WorldSplats:
    """Carry the surfels of an avatar to world coordinates, as `Avatar.render` does.

    Args:
        avatar: The avatar.
        timestep: Timestep of the capture.
        level: Exaggeration, 0 for the natural head.

    Returns:
        The splats, in the order of the surfels.
    """
    sequence = avatar.sequence
    return bake_motion(avatar, sequence.motion(timestep, level), sequence.shade(timestep, level))


def bake_motion(avatar: Avatar, motion: FaceMotion, shade: Float32[np.ndarray, "f 3"] | None) -> WorldSplats:
    """Carry the surfels of an avatar to any posed mesh, in world coordinates.

    The tangents of a skinned disc are the columns of L = J_b k_c R_c r s, which are not orthogonal where the triangle
    shears. With the thin singular value decomposition L = A diag(s) V^T the disc of axes A and scales s has the
    covariance L L^T and the same normal. The light on the triangle multiplies all coefficients of the colour.

    Args:
        avatar: The avatar.
        motion: Motion of the triangles to the posed mesh.
        shade: Factor on the colours of every triangle; None for 1.

    Returns:
        The splats, in the order of the surfels.
    """
    surfels, sequence = avatar.surfels, avatar.sequence
    if avatar.skinning == "similarity":
        motion = similarity_motion(sequence.rig, motion)
    blend = avatar.skinning == "jbs"
    with torch.no_grad():
        skinned = jacobian_blend_skinning(surfels, sequence.rig, motion, blend=blend)
    arrays = {name: value.astype(np.float64) for name, value in to_arrays(surfels).items() if name != "binding"}
    harmonics = arrays["harmonics"]
    if harmonics.shape[1] and avatar.rotate_harmonics:
        harmonics = rotate_harmonics(harmonics, blended_rotations(surfels, motion, blend=blend))
    factor = np.ones((len(surfels), 3)) if shade is None else shade[surfels.binding].astype(np.float64)
    axes, scale = orthogonal_disc_axes(skinned.tangent_u.double().numpy(), skinned.tangent_v.double().numpy())
    return WorldSplats(
        centre=skinned.centre.double().numpy(),
        rotation=Rotation.from_matrix(axes).as_quat(scalar_first=True),
        scale=np.maximum(scale, MIN_SCALE),
        opacity=skinned.opacity.double().numpy().clip(MIN_OPACITY, 1 - MIN_OPACITY),
        colour=(factor * (0.5 + SH_BASE * arrays["colour"]) - 0.5) / SH_BASE,
        harmonics=factor[:, None] * harmonics,
    )


def orthogonal_disc_axes(
    tangent_u: Float[np.ndarray, "n 3"], tangent_v: Float[np.ndarray, "n 3"]
) -> tuple[Float64[np.ndarray, "n 3 3"], Float64[np.ndarray, "n 2"]]:
    """Orthogonal axes of discs whose covariance is u u^T + v v^T.

    Args:
        tangent_u: First tangent of each disc; its length is a standard deviation.
        tangent_v: Second tangent.

    Returns:
        Rotation matrices whose third column points along u x v, and the standard deviations along the first two
        columns.
    """
    tangents = np.stack([tangent_u, tangent_v], axis=2)
    axes, scale, _ = np.linalg.svd(tangents, full_matrices=False)
    normal = np.cross(axes[:, :, 0], axes[:, :, 1])
    flipped = np.einsum("ni,ni->n", normal, np.cross(tangent_u, tangent_v)) < 0
    axes[flipped, :, 1] *= -1
    normal[flipped] *= -1
    return np.concatenate([axes, normal[:, :, None]], axis=2), scale
