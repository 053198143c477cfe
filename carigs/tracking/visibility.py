"""How far landmarks face the cameras: a network guesses those on the far side of the head."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from carigs.fitting.fitted_parameters import FittedParameters
from carigs.head import HeadModel, SurfacePoints
from carigs.head.joint_transforms import rotation_matrices
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.tracking.cameras import Cameras

HIDDEN, SEEN = -0.1, 0.3
"""Cosines between normal and direction to the camera below which a landmark does not count, and above which it counts
fully: a network places an outline as well as the rest."""


def facing_camera(
    model: HeadModel,
    embedding: SurfacePoints,
    fitted: FittedParameters,
    frames: Float[np.ndarray, "t q"],
    cameras: Cameras,
) -> Float[np.ndarray, "t c n"]:
    """Weigh landmarks by how far the template's surface turns towards each camera.

    Args:
        model: The head model.
        embedding: The landmarks on it.
        fitted: The parameters of a frame.
        frames: Parameters of each frame; the rotation of the root counts, and that of the neck.
        cameras: The cameras.

    Returns:
        From 0 to 1.
    """
    normals = embedding.interpolate(vertex_normals(model.v_template.astype(np.float64), model.faces))
    rotation = rotation_matrices(frames[:, 3:6])
    world = np.einsum("tij,nj->tni", rotation, normals)
    points = np.einsum("tij,nj->tni", rotation, embedding.interpolate(model.v_template) - model.joint_template[0])
    points += model.joint_template[0] + frames[:, None, :3]
    matrices = cameras.camera_from_world()
    centres = -np.einsum("cji,cj->ci", matrices[:, :, :3], matrices[:, :, 3])
    towards = centres[:, None] - points[:, None]
    cosine = np.einsum("tni,tcni->tcn", world, towards)
    cosine /= np.linalg.norm(towards, axis=-1) * np.linalg.norm(world, axis=-1)[:, None]
    return np.clip((cosine - HIDDEN) / (SEEN - HIDDEN), 0, 1)
