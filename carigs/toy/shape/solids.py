"""Solids that blend smoothly: the clay that the head is sculpted from."""

from __future__ import annotations

import itertools

import numpy as np
from jaxtyping import Float

# One row per solid: kind, sign (+1 add, -1 carve), blend width, bounding sphere (4), then the solid's own numbers.
ELLIPSOID, CONE = 0, 1
ROW = 24
LINK = 23  # this column is 1 where the next row continues the same solid
FAR = 1e3


def ellipsoid(
    centre: tuple[float, float, float],
    radii: tuple[float, float, float],
    blend: float,
    *,
    carve: bool = False,
    axes: Float[np.ndarray, "3 3"] | None = None,
) -> Float[np.ndarray, "24"]:
    """An ellipsoid; the rows of `axes` are its principal directions (default: the coordinate axes)."""
    row = np.zeros(ROW)
    row[:3] = ELLIPSOID, -1.0 if carve else 1.0, blend
    row[3:7] = *centre, max(radii)
    row[7:10], row[10:13] = centre, radii
    row[13:22] = (np.eye(3) if axes is None else axes).reshape(-1)
    return row


def cone(
    start: tuple[float, float, float],
    start_radius: float,
    end: tuple[float, float, float],
    end_radius: float,
    blend: float,
    *,
    carve: bool = False,
) -> Float[np.ndarray, "24"]:
    """Two spheres and the cone between them."""
    a, b = np.asarray(start, float), np.asarray(end, float)
    row = np.zeros(ROW)
    row[:3] = CONE, -1.0 if carve else 1.0, blend
    row[3:6], row[6] = (a + b) / 2, np.linalg.norm(a - b) / 2 + max(start_radius, end_radius)
    row[7:10], row[10], row[11:14], row[14] = a, start_radius, b, end_radius
    return row


def chain(points: list[tuple[float, ...]], blend: float, *, carve: bool = False, parts: int = 3) -> list[np.ndarray]:
    """One solid: cones along the Catmull-Rom spline through points (x, y, z, radius), `parts` to each span."""
    knots = np.asarray(points, float)
    knots = np.concatenate([2 * knots[:1] - knots[1:2], knots, 2 * knots[-1:] - knots[-2:-1]])
    t = np.arange(parts)[:, None] / parts
    curve = [
        q + 0.5 * t * ((r - p) + t * ((2 * p - 5 * q + 4 * r - s) + t * (3 * (q - r) + s - p)))
        for p, q, r, s in zip(knots[:-3], knots[1:-2], knots[2:-1], knots[3:], strict=True)
    ]
    samples = np.concatenate([*curve, knots[-2:-1]])
    rows = [cone(p[:3], p[3], q[:3], q[3], blend, carve=carve) for p, q in itertools.pairwise(samples)]
    for row in rows[:-1]:
        row[LINK] = 1.0
    return rows
