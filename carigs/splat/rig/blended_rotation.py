"""Rotation of single surfels by Jacobian blend skinning, without the skinning itself."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float64
from scipy.spatial.transform import Rotation

from carigs.splat.rig.face_motion import FaceMotion
from carigs.splat.rig.jacobian_blend import MIN_LOGIT
from carigs.splat.surfels.surfels import Surfels


def blended_rotations(surfels: Surfels, motion: FaceMotion, *, blend: bool = True) -> Float64[np.ndarray, "n 3 3"]:
    """Rotation Q = U exp(sum_i v_i log(U^T U_i)) of every surfel (`jacobian_blend`).

    Args:
        surfels: Surfels in the frames of the triangles.
        motion: Motion of the triangles to the posed mesh.
        blend: Whether neighbours are blended.

    Returns:
        Rotation matrices, posed from canonical.
    """
    own = motion.rotation[surfels.binding].astype(np.float64)
    if not blend:
        return own
    weights = 1 / (1 + np.exp(-np.maximum(surfels.blend.detach().double().numpy(), MIN_LOGIT)))
    weights /= weights.sum(axis=1, keepdims=True)
    vector = np.einsum("ns,nsi->ni", weights[:, 1:], motion.relative_rotation[surfels.binding].astype(np.float64))
    return own @ Rotation.from_rotvec(vector).as_matrix()
