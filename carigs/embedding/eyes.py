"""The eyes of a head model, and the landmarks of its irises: the middle of an eyeball's front, and a ring around it.

They are points of the eyeball's triangles, which the joint of the eye turns: landmarks of an iris tell the gaze.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.detection.mesh_indices import LEFT_IRIS, RIGHT_IRIS
from carigs.errors import MeshError
from carigs.head import HeadModel
from carigs.mesh.ray_caster import RayCaster
from carigs.mesh.triangle_mesh import size

RADIUS = 5.85 / 63
"""Radius of an iris in distances between the eyes: the means of adults are 5.85 mm (Rüfer et al. 2005) and 63 mm."""
DIRECTIONS = ((0, 0), (1, 0), (0, 1), (-1, 0), (0, -1))
"""Centre; right, upper, left, lower edge as an image of the face shows them: the image's right is +x."""


BOUND = 0.5
"""Least weight of an eye's joint at the vertices of its eyeball."""


class Eyes(NamedTuple):
    """The eyes of a head."""

    centres: Float[np.ndarray, "2 3"]
    """Of the left and the right eyeball."""
    left: Bool[np.ndarray, " f"]
    """Triangles of the left eyeball; a head may have none."""
    right: Bool[np.ndarray, " f"]


class IrisPoints(NamedTuple):
    """Points of triangles."""

    landmarks: Int[np.ndarray, " n"]
    """In ascending order."""
    faces: Int[np.ndarray, " n"]
    barycentric: Float[np.ndarray, "n 3"]


def find_eyes(model: HeadModel, landmarks68: Float[np.ndarray, "68 3"] | None) -> Eyes:
    """Find the eyes of a head model.

    Args:
        model: The head model.
        landmarks68: The 68 landmarks of iBUG on its template; None if they are not known.

    Returns:
        Centres in metres: the joints of the eyes, else the middles of the eyeballs, else of the landmarks. Triangles of
        the eyeballs: those of the regions, and those bound to the joints.

    Raises:
        MeshError: If the model has none of them.
    """
    names = ("left_eye", "right_eye")
    joints = [model.joint_names.index(name) for name in names if name in model.joint_names]
    inside = [model.vertex_region(f"{name}ball") for name in names]
    if len(joints) == 2:
        inside = [own | (model.weights[:, joint] > BOUND) for own, joint in zip(inside, joints, strict=True)]
    left, right = (own[model.faces].all(axis=1) for own in inside)
    if len(joints) == 2:
        centres = model.joint_template[joints]
    elif left.any() and right.any():
        corners = [model.v_template[model.faces[own]].reshape(-1, 3).astype(np.float64) for own in (left, right)]
        centres = np.array([(own.min(axis=0) + own.max(axis=0)) / 2 for own in corners])
    elif landmarks68 is not None:
        centres = np.array([landmarks68[42:48].mean(axis=0), landmarks68[36:42].mean(axis=0)])
    else:
        raise MeshError("no joints left_eye and right_eye, no eyeballs and no landmarks68: a model needs one of them")
    return Eyes(centres, left, right)


def iris_points(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], eyes: Eyes) -> IrisPoints:
    """Find the landmarks of the irises on a head whose eyes look to +z.

    Args:
        vertices: Vertices in any unit.
        faces: Triangles.
        eyes: The eyes, in the unit of the vertices.

    Returns:
        Points; none where a line of sight misses the eyeball.
    """
    radius = RADIUS * np.linalg.norm(eyes.centres[0] - eyes.centres[1])
    found = [IrisPoints(np.empty(0, np.int64), np.empty(0, np.int64), np.empty((0, 3)))]
    # The right eye, at the left of an image, has the first landmarks.
    for landmarks, own, centre in ((LEFT_IRIS, eyes.right, eyes.centres[1]), (RIGHT_IRIS, eyes.left, eyes.centres[0])):
        ids = np.flatnonzero(own)
        if not ids.size:
            continue
        unit = size(vertices, faces[ids])
        origins = np.column_stack([centre[:2] + radius * np.array(DIRECTIONS), np.full(5, centre[2] + 2 * unit)])
        hit, _, barycentric = RayCaster(vertices, faces[ids]).first_hit(origins / unit, np.tile([0.0, 0, -1], (5, 1)))
        seen = hit >= 0
        found.append(IrisPoints(np.array(landmarks)[seen], ids[hit[seen]], barycentric[seen]))
    return IrisPoints(*(np.concatenate(parts) for parts in zip(*found, strict=True)))
