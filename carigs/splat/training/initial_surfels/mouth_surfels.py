"""Where surfels of teeth, tongue and the dark of the mouth start: between the lips, on the jaws."""

from __future__ import annotations

import numpy as np

from carigs.capture import Capture
from carigs.capture.evenly_spread import evenly_spread
from carigs.mesh.carried_points import CarriedPoints
from carigs.mouth import find_jaws, has_teeth, lip_gap, lip_line, place_in_mouth
from carigs.settings import Train
from carigs.splat.rig.head_sequence import HeadSequence

POSES = 200
"""Most timesteps whose meshes are looked at, evenly spread."""
TIMESTEPS, CAMERAS = 8, 16
"""Most of them whose frames are looked at, those with the widest open mouth, and most cameras of each."""
OPEN = 0.05
"""Least distance of the inner lips, in widths of the mouth."""


def prepare_mouth(capture: Capture, sequence: HeadSequence, settings: Train) -> CarriedPoints | None:
    """Draw points inside the mouth, and let the triangles that carry them move as two solids.

    Args:
        capture: The capture, for the cameras of its training frames.
        sequence: The subject; receives the motion of the jaws, unless the model has teeth, which are solids.
        settings: Number of points (`mouth_surfels`), and their seed.

    Returns:
        The points; None if the mouth is never open, if the model has no inside of the mouth or no landmarks of the
        lips, or if no view sees a point.
    """
    head, neutral = sequence.head, sequence.rig.vertices
    line = lip_line(head, neutral) if settings.mouth_surfels else None
    if line is None:
        return None
    cameras: dict[int, list] = {}
    for frame in capture.split("train"):
        cameras.setdefault(frame.timestep, []).append(capture.camera(frame))
    posed = {timestep: sequence.posed(timestep, 0.0) for timestep in evenly_spread(sorted(cameras), POSES)}
    gap = {timestep: lip_gap(head, vertices) for timestep, vertices in posed.items()}
    widest = sorted((t for t in posed if gap[t] > OPEN * line.width), key=lambda t: -gap[t])[:TIMESTEPS]
    jaws = find_jaws(head, neutral, list(posed.values()), line) if widest else None
    if jaws is None:
        return None
    views = [(posed[t], evenly_spread(cameras[t], CAMERAS)) for t in widest]
    rng = np.random.default_rng([settings.seed, 3])
    points = place_in_mouth(head, neutral, views, line, jaws, settings.mouth_surfels, rng)
    if not len(points.face):
        return None
    if not has_teeth(head):
        sequence.add_solids(jaws)
    return points
