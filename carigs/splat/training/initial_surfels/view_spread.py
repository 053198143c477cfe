"""From where training views look at the head: where colours that depend on the view can be learned.

Spherical harmonics fit any colours in the directions of the views. Between views that are far apart, and far outside of
the directions of all, they are guesses, which look like noise.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float

from carigs.capture import Capture, Frame
from carigs.capture.evenly_spread import evenly_spread
from carigs.capture.splits import ENOUGH_CAMERAS
from carigs.hair.views import WIDE, largest_gap
from carigs.raster.seen_triangles import seen_triangles
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.rig.solid_motion import Solid

VIEWS = 64
"""Most training frames that are looked at."""
NARROW = 20.0
"""Largest angle in degrees between the mean direction and that of nineteen of twenty views below which colours do not
depend on the view: harmonics would be guesses everywhere else."""


def same_from_all_sides(
    capture: Capture, sequence: HeadSequence, scalp: Bool[np.ndarray, " f"], far_apart: bool
) -> Bool[np.ndarray, " f"]:
    """Find the triangles whose surfels get colours that do not depend on the view.

    Args:
        capture: The capture.
        sequence: The subject, with the motion of its solids.
        scalp: Triangles that carry hair, which views show from more sides than the triangles.
        far_apart: Whether the views are far apart (`are_far_apart`).

    Returns:
        True for all if the views are far apart. Else for those that views show from nearly the same side, or not at
        all: of the body, and before a few cameras of all that carries no hair. Many cameras show highlights on eyes
        and teeth from the sides that count, and before one camera the head turns in the light.
    """
    if far_apart:
        return np.ones(len(scalp), bool)
    frames = capture.split("train")
    looks = [_directions(sequence, capture, frame) for frame in evenly_spread(frames, VIEWS)]
    towards, shown = (np.array(values) for values in zip(*looks, strict=True))
    body = np.zeros(len(scalp), bool) if sequence.solids is None else sequence.solids.solids == Solid.BODY
    shown |= body  # its surfels stand beside its triangles, which may be hidden
    narrow = seen_from_one_side(np.where(shown[..., None], towards, np.nan))
    few = 1 < len({frame.camera for frame in frames}) < ENOUGH_CAMERAS
    return narrow & (~scalp if few else body)


def are_far_apart(capture: Capture, sequence: HeadSequence) -> bool:
    """Whether training views leave a gap of more than `WIDE` between them.

    Args:
        capture: The capture.
        sequence: The subject.

    Returns:
        False for one view.
    """
    frames = evenly_spread(capture.split("train"), VIEWS)
    from_head = np.array([_towards(sequence, capture, frame).mean(axis=0) for frame in frames])
    return largest_gap(from_head / np.linalg.norm(from_head, axis=1, keepdims=True)) > WIDE


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


def _directions(
    sequence: HeadSequence, capture: Capture, frame: Frame
) -> tuple[Float[np.ndarray, "f 3"], Bool[np.ndarray, " f"]]:
    """Directions from the triangles to a camera, in the axes of the canonical head, and which triangles it sees."""
    shown = np.zeros(len(sequence.rig.faces), bool)
    posed, camera = sequence.posed(frame.timestep, 0.0), capture.camera(frame)
    shown[seen_triangles(posed, sequence.rig.faces, camera).index] = True
    return _towards(sequence, capture, frame), shown


def _towards(sequence: HeadSequence, capture: Capture, frame: Frame) -> Float[np.ndarray, "f 3"]:
    """Directions from the triangles to a camera, in the axes of the canonical head."""
    motion = sequence.motion(frame.timestep, 0.0)
    away = capture.camera(frame).centre - motion.centre
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    return np.einsum("fji,fj->fi", motion.rotation, away)
