"""The canonical face of MediaPipe, registered to the template of a head model."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Bool, Float

from carigs.embedding.anchors import find_anchors, similarity_start
from carigs.embedding.canonical_face import canonical_face
from carigs.embedding.eyes import find_eyes, iris_points
from carigs.embedding.landmarks import REGISTRATION, LandmarkEmbedding
from carigs.embedding.outer_skin import outer_skin
from carigs.embedding.registration import ClosestPoints, Surface, closest_points, register
from carigs.errors import MeshError
from carigs.head import HeadModel
from carigs.mesh.triangle_mesh import face_normals, vertex_normals

FARTHEST = 0.1
"""Largest distance of a registered vertex from the head, in half distances between the eyes: 3 mm."""


def register_landmarks(model: HeadModel) -> LandmarkEmbedding:
    """Register the canonical face of MediaPipe to the template of a head model.

    Args:
        model: The head model: it looks to +z, with +y up.

    Returns:
        The landmarks that have a trustworthy place: not far from the head, nor where the registered mesh folds. Those
        of the irises lie on the eyeballs, if the head has any.

    Raises:
        MeshError: If the model has neither eyes nor landmarks, does not look to +z, or has a closed mouth or eye and no
            landmarks.
    """
    vertices, faces = model.v_template.astype(np.float64), model.faces.astype(np.int64)
    landmarks68 = None if model.landmarks68 is None else model.landmarks68.interpolate(vertices)
    eyes = find_eyes(model, landmarks68)
    middle, unit = eyes.centres.mean(axis=0), float(np.linalg.norm(eyes.centres[0] - eyes.centres[1])) / 2
    if not eyes.centres[0, 0] - eyes.centres[1, 0] > unit:
        raise MeshError("the left eye is not at +x beside the right one: a head looks to +z, with +y up")
    # All that follows is in half distances between the eyes.
    vertices, eyes = (vertices - middle) / unit, eyes._replace(centres=(eyes.centres - middle) / unit)
    skin = outer_skin(vertices, faces, ~(eyes.left | eyes.right), eyes.centres)
    anchors = find_anchors(skin, None if landmarks68 is None else (landmarks68 - middle) / unit)
    surface = Surface(vertices, faces[skin.faces])
    placed = register(similarity_start(skin, anchors), canonical_face().faces, surface, anchors)
    closest = closest_points(placed, surface)
    known = np.isin(np.arange(len(placed)), anchors.vertices)
    trusted = np.flatnonzero((closest.distance < FARTHEST) & (known | ~_folded(closest, surface)))
    corners = surface.faces[closest.face[trusted]]
    weights = igl.barycentric_coordinates(closest.position[trusted], *(vertices[corner] for corner in corners.T))
    irises = iris_points(vertices, faces, eyes)
    barycentric = np.clip(np.vstack([weights, irises.barycentric]), 0, 1)
    return LandmarkEmbedding(
        np.concatenate([trusted, irises.landmarks]),
        np.concatenate([np.flatnonzero(skin.faces)[closest.face[trusted]], irises.faces]),
        barycentric / barycentric.sum(axis=1, keepdims=True),
        REGISTRATION,
    )


def _folded(closest: ClosestPoints, surface: Surface) -> Bool[np.ndarray, " n"]:
    """Vertices around which the registered mesh faces against the surface beneath it."""
    own: Float[np.ndarray, "n 3"] = vertex_normals(closest.position, canonical_face().faces)
    return np.einsum("nx,nx->n", own, face_normals(surface.vertices, surface.faces)[closest.face]) < 0
