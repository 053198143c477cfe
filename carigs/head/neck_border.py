"""Where a head model ends: the border of its neck, which lies on the shoulders."""

from __future__ import annotations

from typing import NamedTuple

import igl
import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.head.model import HeadModel

MARGIN = 0.01
"""Metres above the border up to which a point counts as below it."""
RINGS = 3
"""Rings of triangles along the border that may carry the body."""
ROOTED = 0.95
"""Least weight of the root joint on triangles that carry the body: others turn with the neck."""
LEAST_CARRIERS = 20
"""Triangles at least; of models without such weights, all triangles along the border carry the body."""
LEAST_LENGTH = 0.15
"""Metres around a neck at least; other borders are those of eyes, mouth and cut ends."""


class NeckBorder(NamedTuple):
    """The lowest border of a neutral head."""

    vertices: Int[np.ndarray, " b"]
    """Around the neck."""
    carriers: Bool[np.ndarray, " f"]
    """Triangles along it that move with the torso."""
    centre: Float[np.ndarray, "3"]
    """Mean of the vertices, in metres."""
    azimuth: Float[np.ndarray, " b"]
    """Direction of each vertex from the centre in radians, about the y axis, in ascending order."""
    height: Float[np.ndarray, " b"]
    """y of these vertices in metres."""

    def lies_above(self, points: Float[np.ndarray, "n 3"]) -> Bool[np.ndarray, " n"]:
        """Whether points are higher than the border in their direction from the neck.

        Args:
            points: In the axes of the neutral head, in metres.

        Returns:
            False for shoulders and what hangs in front of them.
        """
        arm = points - self.centre
        border = np.interp(np.arctan2(arm[:, 0], arm[:, 2]), self.azimuth, self.height, period=2 * np.pi)
        return points[:, 1] > border + MARGIN


def neck_border(model: HeadModel, vertices: Float[np.ndarray, "v 3"]) -> NeckBorder | None:
    """Find the border of the neck.

    Args:
        model: The head model.
        vertices: Vertices of a subject's neutral head in metres; y is up.

    Returns:
        The border; None if the head has none at its lower end.
    """
    faces = np.asarray(model.faces, np.int64)
    loops = [np.array(loop) for loop in igl.boundary_loop_all(faces)]
    lengths = [np.linalg.norm(vertices[loop] - vertices[np.roll(loop, 1)], axis=1).sum() for loop in loops]
    loops = [loop for loop, length in zip(loops, lengths, strict=True) if length > LEAST_LENGTH]
    if not loops:
        return None
    loop = min(loops, key=lambda loop: vertices[loop, 1].mean())
    if vertices[loop, 1].mean() > vertices[:, 1].mean():
        return None
    near = np.zeros(len(vertices), bool)
    near[loop] = True
    inside = near[faces].any(axis=1)
    for _ in range(RINGS - 1):
        near[faces[inside]] = True
        inside = near[faces].any(axis=1)
    rooted = inside & (model.weights[faces, 0] > ROOTED).all(axis=1)
    carriers = rooted if rooted.sum() >= LEAST_CARRIERS else inside
    centre = vertices[loop].mean(axis=0)
    arm = vertices[loop] - centre
    azimuth = np.arctan2(arm[:, 0], arm[:, 2])
    order = np.argsort(azimuth)
    return NeckBorder(loop, carriers, centre, azimuth[order], vertices[loop[order], 1])
