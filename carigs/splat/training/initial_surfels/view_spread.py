"""From where training views look at the head: where colours that depend on the view can be learned.

Spherical harmonics fit any colours in the directions of the views. Between views that are far apart, and far outside of
the directions of all, they are guesses, which look like noise.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse.csgraph import minimum_spanning_tree

from carigs.capture import Camera, Capture, Frame
from carigs.capture.evenly_spread import evenly_spread
from carigs.capture.splits import ENOUGH_CAMERAS
from carigs.mesh.triangle_mesh import barycenters, face_normals
from carigs.raster import compute_visibility
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.rig.solid_motion import Solid

VIEWS = 64
"""Most training frames that are looked at."""
NARROW = 20.0
"""Largest angle in degrees between the mean direction and that of nineteen of twenty views below which colours do not
depend on the view: harmonics would be guesses everywhere else."""
WIDE = 45.0
"""Angle in degrees between neighbouring views, as the head sees them, from which on no colours depend on the view."""
BEHIND = 0.003
"""Metres that the centre of a triangle may lie behind the surface that a pixel shows, and still count as seen."""


def same_from_all_sides(
    capture: Capture, sequence: HeadSequence, scalp: Bool[np.ndarray, " f"]
) -> Bool[np.ndarray, " f"]:
    """Find the triangles whose surfels get colours that do not depend on the view.

    Args:
        capture: The capture.
        sequence: The subject, with the motion of its solids.
        scalp: Triangles that carry hair, which views show from more sides than the triangles.

    Returns:
        True for all if the views are far from each other (`largest_gap`). Else for those that views show from nearly
        the same side, or not at all: of the body, and before a few cameras of all that carries no hair. Many cameras
        show highlights on eyes and teeth from the sides that count, and before one camera the head turns in the light.
    """
    frames = capture.split("train")
    views = [_Look(sequence, capture, frame) for frame in evenly_spread(frames, VIEWS)]
    if largest_gap(np.array([view.from_head for view in views])) > WIDE:
        return np.ones(len(scalp), bool)
    narrow = seen_from_one_side(np.array([view.from_triangles for view in views]))
    if 1 < len({frame.camera for frame in frames}) < ENOUGH_CAMERAS:
        return narrow & ~scalp
    body = np.zeros(len(scalp), bool) if sequence.solids is None else sequence.solids.solids == Solid.BODY
    return narrow & body


def largest_gap(directions: Float[np.ndarray, "n 3"]) -> float:
    """How far directions lie apart that have no others in between.

    Args:
        directions: Unit vectors.

    Returns:
        Degrees: the longest edge of the minimum spanning tree, whose removal divides the directions into two groups.
    """
    cosine = np.clip(directions @ directions.T, -1, 1)
    angle = np.degrees(np.arccos(cosine)) + 1e-9  # an edge of length 0 would be none
    return float(minimum_spanning_tree(angle).max()) if len(directions) > 1 else 0.0


def seen_from_one_side(directions: Float[np.ndarray, "v f 3"]) -> Bool[np.ndarray, " f"]:
    """Find what all views show from nearly the same side.

    Args:
        directions: Unit vectors towards the camera of each view, in the axes of the canonical head; NaN where a view
            does not show a triangle.

    Returns:
        True for triangles whose views lie within `NARROW` of their mean direction, but for one of twenty, and for those
        that no view shows.
    """
    known = np.isfinite(directions[:, :, 0]).any(axis=0)
    views = directions[:, known]
    mean = np.nansum(views, axis=0)
    mean /= np.maximum(np.linalg.norm(mean, axis=1, keepdims=True), 1e-9)
    cosine = np.nanquantile(np.einsum("vfc,fc->vf", views, mean), 0.05, axis=0)
    narrow = np.ones(directions.shape[1], bool)
    narrow[known] = np.degrees(np.arccos(np.clip(cosine, -1, 1))) < NARROW
    return narrow


class _Look:
    """Directions from the head and its triangles to a camera, in the axes of the canonical head."""

    def __init__(self, sequence: HeadSequence, capture: Capture, frame: Frame) -> None:
        faces, camera = sequence.rig.faces, capture.camera(frame)
        motion, posed = sequence.motion(frame.timestep, 0.0), sequence.posed(frame.timestep, 0.0)
        away = camera.centre - motion.centre
        away /= np.linalg.norm(away, axis=1, keepdims=True)
        local = np.einsum("fji,fj->fi", motion.rotation, away)
        mean = local.mean(axis=0)
        self.from_head = mean / np.linalg.norm(mean)
        shown = _seen(posed, faces, camera)
        if sequence.solids is not None:  # surfels of the body stand beside its triangles
            shown |= sequence.solids.solids == Solid.BODY
        self.from_triangles = np.where(shown[:, None], local, np.nan)


def _seen(posed: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], camera: Camera) -> Bool[np.ndarray, " f"]:
    """Whether a camera sees the centre of each triangle."""
    centre, inverse_depth = barycenters(posed, faces), compute_visibility(posed, faces, camera).inverse_depth
    facing = np.einsum("nc,nc->n", face_normals(posed, faces), camera.centre - centre) > 0
    pixel, depth = camera.project(centre)
    inside = facing & (depth > 0) & (pixel >= 0).all(axis=1) & (pixel < [camera.width, camera.height]).all(axis=1)
    column, row = np.where(inside[:, None], pixel, 0).astype(int).T
    return inside & ((depth - BEHIND) * inverse_depth[row, column] < 1)
