"""Primitive solids for smooth constructive solid geometry: ellipsoids, round cones and chains of round cones.

Lengths and coordinates are in millimetres.
"""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Float, Shaped

SOLID = np.dtype([
    ("is_cone", bool), ("carve", bool),
    ("continued", bool),  # by the next row, which belongs to the same solid
    ("blend", float),
    ("centre", float, 3), ("reach", float),  # bounding sphere
    ("radii", float, 3), ("axes", float, (3, 3)),  # of an ellipsoid
    ("start", float, 4), ("end", float, 4),  # of a round cone: spheres (x, y, z, radius)
])  # fmt: skip
"""One row of the array that the kernels of `carigs.toy.shape.signed_distance` read."""
Point = tuple[float, ...]


def _solid(**values: object) -> Shaped[np.ndarray, ""]:
    solid = np.zeros((), SOLID)
    for name, value in values.items():
        solid[name] = value
    return solid


def ellipsoid(
    centre: Point, radii: Point, blend: float, *, carve: bool = False, axes: Float[np.ndarray, "3 3"] | None = None
) -> Shaped[np.ndarray, ""]:
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
    axes = np.eye(3) if axes is None else axes
    return _solid(blend=blend, carve=carve, centre=centre, reach=max(radii), radii=radii, axes=axes)


def round_cone(start: Point, end: Point, blend: float, *, carve: bool = False) -> Shaped[np.ndarray, ""]:
    """Two spheres and the cone between them.

    Args:
        start: The first sphere (x, y, z, radius).
        end: The second sphere.
        blend: Width over which the solid blends with the solids before it; 0 gives a sharp crease.
        carve: Whether it is subtracted.

    Returns:
        Its row.
    """
    a, b = np.asarray(start, float), np.asarray(end, float)
    reach = np.linalg.norm(a[:3] - b[:3]) / 2 + max(a[3], b[3])
    return _solid(is_cone=True, blend=blend, carve=carve, centre=(a + b)[:3] / 2, reach=reach, start=a, end=b)


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
    spheres = np.concatenate([*curve, knots[-2:-1]])
    rows = [round_cone(p, q, blend, carve=carve) for p, q in itertools.pairwise(spheres)]
    for row in rows[:-1]:
        row["continued"] = True
    return rows
