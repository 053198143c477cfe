"""Where surfels of the body start: below the border of the neck, whose triangles carry them as one solid."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool

from carigs.hair import FoundHair
from carigs.head.neck_border import neck_border
from carigs.mesh.carried_points import CarriedPoints, draw_points, nearest_triangles
from carigs.settings import Train
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.rig.solid_motion import Solid

COUNT = 6000
"""Number of points."""


def prepare_body(
    found: FoundHair, sequence: HeadSequence, settings: Train, kept: Bool[np.ndarray, " f"] | None = None
) -> CarriedPoints | None:
    """Draw points of the visible body, and let the border of the neck move with it as a solid.

    Args:
        found: What the frames show beside the head.
        sequence: The subject; receives the motion of the body.
        settings: Seed of the points.
        kept: Triangles that are not trained, which carry none of these points; None if there are none.

    Returns:
        The points; None if no body is seen.
    """
    vertices, faces = sequence.rig.vertices, sequence.rig.faces
    border = neck_border(sequence.head, vertices)
    if found.body is None or border is None or not found.body.visible.any():
        return None
    volume, visible = found.body
    rng = np.random.default_rng([settings.seed, 4])
    weight = volume.opacity * np.sqrt(visible)
    _, position, spacing = draw_points(volume.centres, volume.size, weight, COUNT, rng)
    sequence.add_solids(np.where(border.carriers, Solid.BODY, Solid.NONE).astype(np.uint8))
    trained = border.carriers if kept is None else border.carriers & ~kept
    carriers = nearest_triangles(position, np.flatnonzero(trained), vertices, faces)
    away = position - border.centre * [1, 0, 1] - [0, 1, 0] * position  # from the axis of the neck
    normal = away / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-9)
    along = np.cross([0.0, 1.0, 0.0], normal)
    axes = np.stack([along, np.cross(normal, along)], axis=2)
    return CarriedPoints(carriers, position, spacing, axes, np.ones(len(position)))
