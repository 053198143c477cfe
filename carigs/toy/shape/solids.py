"""Primitive solids for smooth constructive solid geometry: ellipsoids, round cones and chains of round cones.

Lengths and coordinates are in millimetres. A solid is one row of numbers, which the kernels of
`carigs.toy.shape.signed_distance` read.
"""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Float

# Columns: 0 kind, 1 sign (+1 add, -1 carve), 2 blend width, 3-6 bounding sphere (centre, radius). Then an ellipsoid has
# 7-9 centre, 10-12 radii, 13-21 axes; a round cone has 7-9 start, 10 start radius, 11-13 end, 14 end radius.
ELLIPSOID, ROUND_CONE = 0, 1
ROW = 24
LINK = 23  # this column is 1 where the next row continues the same solid
FAR = 1e3
Point = tuple[float, ...]


def ellipsoid(
    centre: Point, radii: Point, blend: float, *, carve: bool = False, axes: Float[np.ndarray, "3 3"] | None = None
) -> Float[np.ndarray, "24"]:
    """An ellipsoid.

    Args:
        centre: Its centre.
        radii: Half lengths of its principal axes.
        blend: Width over which it blends with the solids before it; 0 gives a sharp crease.
        carve: Whether it is subtracted.
        axes: Unit principal directions as rows; None: the coordinate axes.

    Returns:
        Its row.
    """
    row = np.zeros(ROW)
    row[:3] = ELLIPSOID, -1.0 if carve else 1.0, blend
    row[3:7] = *centre, max(radii)
    row[7:10], row[10:13] = centre, radii
    row[13:22] = (np.eye(3) if axes is None else axes).reshape(-1)
    return row


def round_cone(
    start: Point, start_radius: float, end: Point, end_radius: float, blend: float, *, carve: bool = False
) -> Float[np.ndarray, "24"]:
    """Two spheres and the cone between them.

    Args:
        start: Centre of the first sphere.
        start_radius: Its radius.
        end: Centre of the second sphere.
        end_radius: Its radius.
        blend: Width over which the solid blends with the solids before it; 0 gives a sharp crease.
        carve: Whether it is subtracted.

    Returns:
        Its row.
    """
    a, b = np.asarray(start, float), np.asarray(end, float)
    row = np.zeros(ROW)
    row[:3] = ROUND_CONE, -1.0 if carve else 1.0, blend
    row[3:6], row[6] = (a + b) / 2, np.linalg.norm(a - b) / 2 + max(start_radius, end_radius)
    row[7:10], row[10], row[11:14], row[14] = a, start_radius, b, end_radius
    return row


def chain(points: list[Point], blend: float, *, carve: bool = False, parts: int = 3) -> list[np.ndarray]:
    """One solid of round cones along a Catmull-Rom spline.

    Args:
        points: Control points (x, y, z, radius).
        blend: Width over which the chain blends with the solids before it.
        carve: Whether it is subtracted.
        parts: Round cones between two control points.

    Returns:
        Its rows.
    """
    knots = np.asarray(points, float)
    knots = np.concatenate([2 * knots[:1] - knots[1:2], knots, 2 * knots[-1:] - knots[-2:-1]])
    t = np.arange(parts)[:, None] / parts
    curve = [
        q + 0.5 * t * ((r - p) + t * ((2 * p - 5 * q + 4 * r - s) + t * (3 * (q - r) + s - p)))
        for p, q, r, s in zip(knots[:-3], knots[1:-2], knots[2:-1], knots[3:], strict=True)
    ]
    samples = np.concatenate([*curve, knots[-2:-1]])
    rows = [round_cone(p[:3], p[3], q[:3], q[3], blend, carve=carve) for p, q in itertools.pairwise(samples)]
    for row in rows[:-1]:
        row[LINK] = 1.0
    return rows
