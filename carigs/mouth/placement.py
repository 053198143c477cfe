"""Points inside the mouth that cameras see between the lips."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from carigs.capture import Camera
from carigs.head import HeadModel
from carigs.mesh.carried_points import CarriedPoints, draw_points, nearest_triangles
from carigs.mesh.rigid_alignment import rigid_alignment
from carigs.mesh.triangle_mesh import barycenters
from carigs.mouth.jaw import Jaw
from carigs.mouth.lip_line import LipLine
from carigs.raster import compute_visibility
from carigs.raster.open_mouth import between_lips

STEP = 1 / 40
"""Distance of the points that are tried, in widths of the mouth, as all lengths here."""
HALF_WIDTH, HALF_HEIGHT, DEPTH = 0.5, 0.35, (0.05, 0.6)
"""Where they are: across the lips, above and below the line where these meet, and behind it."""
TOLERANCE = 0.0005
"""Metres that a point has to be in front of the mesh to be seen."""
SEEN = 0.03
"""Least share of the views that see a point that is kept."""


def place_in_mouth(
    model: HeadModel,
    neutral: Float[np.ndarray, "v 3"],
    views: Sequence[tuple[Float[np.ndarray, "v 3"], Iterable[Camera]]],
    line: LipLine,
    jaws: UInt8[np.ndarray, " f"],
    count: int,
    rng: np.random.Generator,
) -> CarriedPoints:
    """Draw points of the mouth, more where more views see them.

    A point above the line of the lips moves with the upper jaw, one below with the lower jaw, as the rigid motions that
    fit the triangles of the jaws best.

    Args:
        model: Head model with landmarks.
        neutral: Vertices of the subject's neutral head in metres.
        views: The posed head at timesteps with an open mouth, each with cameras.
        line: Where the lips meet.
        jaws: A `Jaw` for every triangle.
        count: Number of points.
        rng: Draws them.

    Returns:
        The points, each carried by the nearest triangle of its jaw; none if no view sees any.
    """
    points, upper = _candidates(line)
    share = _share_of_views(points, upper, model, neutral, views, jaws)
    weight = np.sqrt(share * (share > SEEN))
    if not weight.any():
        return CarriedPoints(np.zeros(0, np.int64), np.zeros((0, 3)), np.zeros(0), np.zeros((0, 3, 2)), np.zeros(0))
    chosen, position, spacing = draw_points(points, STEP * line.width, weight, count, rng)
    face = np.zeros(count, np.int64)
    for jaw, mine in ((Jaw.UPPER, upper[chosen]), (Jaw.LOWER, ~upper[chosen])):
        face[mine] = nearest_triangles(position[mine], np.flatnonzero(jaws == jaw), neutral, model.faces)
    return CarriedPoints(face, position, spacing, np.tile(np.eye(3)[:, :2], (count, 1, 1)), np.ones(count))


def _candidates(line: LipLine) -> tuple[Float[np.ndarray, "n 3"], Bool[np.ndarray, " n"]]:
    """A grid of points behind the lips, and whether they belong to the upper jaw."""
    width = line.width
    across, up = (np.arange(-half, half, STEP) + STEP / 2 for half in (HALF_WIDTH, HALF_HEIGHT))
    back = np.arange(-DEPTH[1], -DEPTH[0] + 0.5, STEP)  # the corners of the mouth are behind its middle
    grid = np.stack(np.meshgrid(across, up, back, indexing="ij"), axis=-1).reshape(-1, 3)
    points = line.middle + width * grid
    depth = line.depth(points)
    points = points[(depth > DEPTH[0] * width) & (depth < DEPTH[1] * width)]
    return points, line.height(points) >= 0


def _share_of_views(
    points: Float[np.ndarray, "n 3"],
    upper: Bool[np.ndarray, " n"],
    model: HeadModel,
    neutral: Float[np.ndarray, "v 3"],
    views: Sequence[tuple[Float[np.ndarray, "v 3"], Iterable[Camera]]],
    jaws: UInt8[np.ndarray, " f"],
) -> Float[np.ndarray, " n"]:
    """Share of the views that see each point between the lips, in front of the mesh."""
    seen, total = np.zeros(len(points)), 0
    carriers = {jaw: model.faces[jaws == jaw] for jaw in (Jaw.UPPER, Jaw.LOWER)}
    for posed, cameras in views:
        moved = np.empty_like(points)
        for jaw, mine in ((Jaw.UPPER, upper), (Jaw.LOWER, ~upper)):
            moved[mine] = _carried(points[mine], carriers[jaw], neutral, posed)
        for camera in cameras:
            visibility = compute_visibility(posed, model.faces, camera)
            shown = np.where(between_lips(visibility, model), visibility.inverse_depth, np.inf)
            pixel, depth = camera.project(moved)
            inside = (
                (depth > TOLERANCE) & (pixel >= 0).all(axis=1) & (pixel < [camera.width, camera.height]).all(axis=1)
            )
            column, row = np.where(inside[:, None], pixel, 0).astype(int).T
            seen += inside & ((depth + TOLERANCE) * shown[row, column] < 1)
            total += 1
    return seen / max(total, 1)


def _carried(
    points: Float[np.ndarray, "n 3"],
    carriers: Int[np.ndarray, "c 3"],
    neutral: Float[np.ndarray, "v 3"],
    posed: Float[np.ndarray, "v 3"],
) -> Float[np.ndarray, "n 3"]:
    """Points that move with some triangles as a solid."""
    source, target = barycenters(neutral, carriers), barycenters(posed, carriers)
    rotation, translation = rigid_alignment(source, target)
    return points @ rotation.T + translation
