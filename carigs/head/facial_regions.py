"""Triangles of brows and lids: regions of the head model, or places near its landmarks and eyeballs."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Bool, Float

from carigs.head.model import HeadModel

BROWS = range(17, 27)
"""Landmarks of both brows in the 68-point scheme of iBUG."""
BROW_LINES = [(i, i + 1) for i in (0, 1, 2, 3, 5, 6, 7, 8)]
"""Segments of both brows, as places in `BROWS`."""
EYE_CORNERS = (36, 45)
EYEBALLS, LIDS = ("left_eyeball", "right_eyeball"), ("left_eyelid", "right_eyelid")
EARS, MOUTH = ("left_ear", "right_ear"), ("lip_inside",)
"""Names of regions; those that a model lacks are ignored. `MOUTH` is its inside."""


def brow_faces(model: HeadModel, neutral: Float[np.ndarray, "v 3"]) -> Bool[np.ndarray, " f"] | None:
    """Find the triangles of the brows.

    Args:
        model: Head model.
        neutral: Vertices of the subject's neutral head in metres.

    Returns:
        The region `brows`; without it, the triangles nearer to the lines through the landmarks of the brows than 10 %
        of the distance between the outer corners of the eyes; None if the model has neither.
    """
    if "brows" in model.regions:
        return model.face_region("brows")
    if model.landmarks68 is None:
        return None
    landmarks = model.landmarks68.interpolate(neutral)
    corners = landmarks[list(EYE_CORNERS)]
    width = 0.1 * float(np.linalg.norm(corners[1] - corners[0]))
    lines = np.array(BROW_LINES)
    squared = igl.point_mesh_squared_distance(np.asarray(neutral, np.float64), landmarks[list(BROWS)], lines)[0]
    near = (squared < width**2) & ~model.vertex_region(*EYEBALLS)
    return near[model.faces].all(axis=1)


def lid_faces(model: HeadModel, neutral: Float[np.ndarray, "v 3"]) -> Bool[np.ndarray, " f"]:
    """Find the triangles of the lids.

    Args:
        model: Head model.
        neutral: Vertices of the subject's neutral head in metres.

    Returns:
        The regions `left_eyelid` and `right_eyelid`; without them, the triangles of the eye regions within a quarter of
        the eyeball's radius of an eyeball, hence also on closed eyes.
    """
    lids = model.face_region(*LIDS)
    if lids.any():
        return lids
    near = np.zeros(len(neutral), bool)
    for side in ("left", "right"):
        ball = neutral[model.vertex_region(f"{side}_eyeball")]
        if not len(ball):  # a region may be empty
            continue
        low, high = ball.min(axis=0), ball.max(axis=0)
        radius = 0.5 * float((high - low).max())
        distance = np.linalg.norm(neutral - 0.5 * (low + high), axis=1)
        near |= model.vertex_region(f"{side}_eye_region", "eye_region") & (distance < 1.25 * radius)
    return near[model.faces].all(axis=1)


def eye_and_brow_faces(model: HeadModel, neutral: Float[np.ndarray, "v 3"]) -> Bool[np.ndarray, " f"]:
    """Find the triangles of eyeballs, lids and brows.

    Args:
        model: Head model.
        neutral: Vertices of the subject's neutral head in metres.

    Returns:
        Eyeballs, `lid_faces` and, if the model tells where they are, `brow_faces`.
    """
    found = model.face_region("left_eyeball", "right_eyeball") | lid_faces(model, neutral)
    brows = brow_faces(model, neutral)
    return found if brows is None else found | brows
