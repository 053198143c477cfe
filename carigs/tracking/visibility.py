"""How far landmarks count in a camera: a network guesses the far side of a head, and from the side its mouth."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.spatial import cKDTree

from carigs.fitting.fitted_parameters import FittedParameters
from carigs.fitting.head_points import HeadPoints
from carigs.head import HeadModel, SurfacePoints
from carigs.head.joint_transforms import rotation_matrices
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.tracking.cameras import Cameras

HIDDEN, SEEN = -0.1, 0.3
"""Cosines between normal and direction to the camera below which a landmark does not count, and above which it counts
fully: a network places an outline as well as the rest."""
NEIGHBOURHOOD = 0.015
"""Metres within which the normals of landmarks are averaged. The edges of lids and lips face upwards, downwards and
inwards, and are seen with the face around them: by its own normal, the lower lid did not count in three of four frames,
those of blinks among them."""
PREFERENCE = 16.0
"""Exponent of the cosine between face and camera, against that of the best camera, for landmarks that move most: one
from 45 degrees counts 1 / 250 of one from the front."""
JAW = 0.3
"""Radians of an open jaw."""
MOVED = 0.02
"""Metres by which expressions and jaw move the landmarks that move most: chin and lower lip."""


def facing_camera(
    model: HeadModel,
    embedding: SurfacePoints,
    fitted: FittedParameters,
    frames: Float[np.ndarray, "t q"],
    cameras: Cameras,
    *,
    neighbourhood: float = NEIGHBOURHOOD,
) -> Float[np.ndarray, "t c n"]:
    """Weigh landmarks by how far the template's surface turns towards each camera.

    Args:
        model: The head model.
        embedding: The landmarks on it.
        fitted: The parameters of a frame.
        frames: Parameters of each frame; the rotation of the root counts, and that of the neck.
        cameras: The cameras.
        neighbourhood: Metres within which the normals of the points are averaged; 0 to take each for itself.

    Returns:
        From 0 to 1.
    """
    template = model.v_template.astype(np.float64)
    normals = embedding.interpolate(vertex_normals(template, model.faces))
    normals = _around(embedding.interpolate(template), normals, neighbourhood)
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


def _around(
    points: Float[np.ndarray, "n 3"], normals: Float[np.ndarray, "n 3"], radius: float
) -> Float[np.ndarray, "n 3"]:
    """Sums of the unit normals of the points around each point."""
    units = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    pairs = cKDTree(points).query_pairs(radius, output_type="ndarray")
    total = units.copy()
    np.add.at(total, pairs[:, 0], units[pairs[:, 1]])
    np.add.at(total, pairs[:, 1], units[pairs[:, 0]])
    return total


def preferred_views(
    points: HeadPoints, jaw: slice | None, frames: Float[np.ndarray, "t q"], cameras: Cameras
) -> Float[np.ndarray, "t c n"]:
    """Weigh moving landmarks by which camera sees the face most from the front.

    From the side, a network takes a mouth that is wide open for half closed: in two cameras 46 degrees beside a real
    person it found a gap between the lips of 10 to 20 pixels where the front has 30, and the mouth of the head followed
    the two. What the skull carries, the network places well from everywhere.

    Args:
        points: The landmarks on the template.
        jaw: The jaw's rotation among the parameters of a frame, if it has any.
        frames: Parameters of each frame; the rotation of the root counts.
        cameras: The cameras.

    Returns:
        From 0 to 1; 1 for all in the camera that sees the face best.
    """
    faces = rotation_matrices(frames[:, 3:6])[:, :, 2]
    matrices = cameras.camera_from_world()
    centres = -np.einsum("cji,cj->ci", matrices[:, :, :3], matrices[:, :, 3])
    towards = centres - frames[:, None, :3]
    cosine = np.einsum("tcx,tx->tc", towards, faces) / np.linalg.norm(towards, axis=-1)
    cosine = np.maximum(cosine, 0.01)
    relative = cosine / cosine.max(axis=1, keepdims=True)
    return relative[..., None] ** (PREFERENCE * _mobility(points, jaw))


def _mobility(points: HeadPoints, jaw: slice | None) -> Float[np.ndarray, " n"]:
    """How far expressions and the jaw move each landmark, from 0 to 1."""
    fitted = points.fitted
    count = len(fitted.expression)
    each = np.zeros((count + 2, fitted.frame_size))
    each[np.arange(count), np.arange(fitted.frame_size - count, fitted.frame_size)] = 1
    if jaw is not None:
        each[count, jaw.start] = JAW
    places = points.positions(each, np.zeros(len(fitted.shape)))
    return (np.linalg.norm(places - places[-1], axis=-1).max(axis=0) / MOVED).clip(0, 1)
