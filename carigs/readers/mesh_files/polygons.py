"""Polygons of a mesh file, and how they are cut into triangles.

A polygon is cut into a fan from its first corner if all triangles of the fan face the same way. Others are not convex,
or have corners on a straight line: of a quadrilateral the other diagonal is taken, and of others ears are clipped
(Meisters 1975: every simple polygon has two corners whose triangle holds no other corner).
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float64, Int, Int64

from carigs.errors import CarigsWarning, InputError
from carigs.readers.mesh_files.coincident import places, triangles_of_twins

FLAT = 1e-5
"""Roundness of a triangle (1 if it is equilateral) below which its corners count as points of a straight line."""
MAX_TESTS = 200_000_000
"""Most tests of points in triangles: clipping the ears of one polygon of n corners takes n^3."""
_TESTS_AT_ONCE = 1 << 20


class Polygons(NamedTuple):
    """Polygons of a mesh, in the order of its file."""

    vertices: Float64[np.ndarray, "v 3"]
    corners: Int64[np.ndarray, " c"]
    """Vertex numbers from 0, polygon after polygon."""
    lengths: Int64[np.ndarray, " p"]
    """Number of corners of each polygon, at least 3."""


def triangulate_polygons(polygons: Polygons, file: str | Path) -> Int64[np.ndarray, "f 3"]:
    """Cut polygons into triangles with the corners of the polygons: n - 2 from a polygon of n corners.

    Corners need not lie in a plane: which triangles face which way is decided along the normal of the polygon's mean
    plane (Newell's method).

    Args:
        polygons: The polygons.
        file: Their file, for messages.

    Returns:
        Vertex numbers of the triangles, polygon after polygon, which face to where the polygon faces.

    Raises:
        InputError: If polygons that are not convex have too many corners.

    Warns:
        CarigsWarning: A polygon crosses itself or is folded, so that some of its triangles face the other way.
    """
    vertices, corners, lengths = polygons
    first_triangle = np.cumsum(lengths - 2) - (lengths - 2)
    first_corner = np.cumsum(lengths) - lengths
    triangles = np.empty((int((lengths - 2).sum()), 3), np.int64)
    place = places(vertices) if (lengths > 3).any() else np.zeros(0, np.int64)
    crossing: list[int] = []
    tests = 0
    for n in np.unique(lengths).tolist():
        chosen = np.flatnonzero(lengths == n)
        polygon = corners[first_corner[chosen, None] + np.arange(n)]
        order = np.tile(_fan(n), (len(chosen), 1, 1))
        if n > 3:
            with np.errstate(over="ignore", invalid="ignore"):  # of coordinates that are refused later
                flat, cancels = _in_mean_plane(vertices[polygon])
                other = np.flatnonzero(_least_round(flat, order) <= FLAT)
                tests += n**3 * len(other) if n > 4 else 0
                if tests > MAX_TESTS:
                    problem = f"too many corners of polygons that are not convex, one has {n}; cut them into triangles"
                    raise InputError(problem, file=file, field="faces")
                order[other] = _better_diagonal(flat[other]) if n == 4 else _clip_ears(flat[other])
                crosses = cancels[other] | (_least_round(flat[other], order[other]) < -FLAT)
                order = triangles_of_twins(place[polygon], order)
            crossing += chosen[other[crosses]].tolist()
        rows = np.arange(len(chosen))[:, None, None]
        triangles[first_triangle[chosen, None] + np.arange(n - 2)] = polygon[rows, order]
    if crossing:
        first = f"the first is face {min(crossing)}, from 0"
        problem = (
            f"{len(crossing)} polygons cross themselves or are folded ({first}); not all of their triangles face alike"
        )
        warnings.warn(f"{file}: {problem}", CarigsWarning, stacklevel=2)
    return triangles


def _fan(n: int) -> Int64[np.ndarray, "t 3"]:
    """Corners of the triangles from the first corner of a polygon of n corners."""
    second = np.arange(1, n - 1)
    return np.stack([np.zeros_like(second), second, second + 1], axis=1)


def _in_mean_plane(points: Float[np.ndarray, "m n 3"]) -> tuple[Float[np.ndarray, "m n 2"], Bool[np.ndarray, " m"]]:
    """Corners projected along the mean normal, counterclockwise, in units of the polygon's size.

    Also whether there is no such normal though there is an area: halves of a polygon that crosses itself cancel out.
    """
    points = points - points.mean(axis=1, keepdims=True)
    points = points / np.maximum(np.abs(points).max(axis=(1, 2), keepdims=True), 1e-300)
    normal = np.cross(points, np.roll(points, -1, axis=1)).sum(axis=1)
    length = np.linalg.norm(normal, axis=1)
    normal /= np.maximum(length, 1e-300)[:, None]
    x = np.cross(np.eye(3)[np.abs(normal).argmin(axis=1)], normal)
    x /= np.maximum(np.linalg.norm(x, axis=1, keepdims=True), 1e-300)
    flat = np.stack([np.einsum("mnk,mk->mn", points, d) for d in (x, np.cross(normal, x))], axis=-1)
    edges = points[:, 1:] - points[:, :1]
    area = np.linalg.norm(np.cross(edges[:, :-1], edges[:, 1:]), axis=2).sum(axis=1)
    return flat, (length < FLAT * area) & (area > FLAT)


def _least_round(flat: Float[np.ndarray, "m n 2"], order: Int[np.ndarray, "m t 3"]) -> Float[np.ndarray, " m"]:
    """The smallest roundness of the triangles of each polygon."""
    a, b, c = np.moveaxis(flat[np.arange(len(flat))[:, None, None], order], 2, 0)
    return _roundness(a, b, c).min(axis=1)


def _roundness(
    a: Float[np.ndarray, "*s 2"], b: Float[np.ndarray, "*s 2"], c: Float[np.ndarray, "*s 2"]
) -> Float[np.ndarray, "*s"]:
    """1 for an equilateral triangle, 0 for one without area; negative if its corners turn clockwise."""
    squares = ((b - a) ** 2 + (c - b) ** 2 + (a - c) ** 2).sum(axis=-1)
    return 2 * np.sqrt(3) * _cross(b - a, c - a) / np.maximum(squares, 1e-300)


def _cross(p: Float[np.ndarray, "*#s 2"], q: Float[np.ndarray, "*#s 2"]) -> Float[np.ndarray, "*s"]:
    return p[..., 0] * q[..., 1] - p[..., 1] * q[..., 0]


def _better_diagonal(flat: Float[np.ndarray, "m 4 2"]) -> Int64[np.ndarray, "m 2 3"]:
    """The two triangles of a quadrilateral: of both pairs the one with the rounder triangles, the first if equal."""
    pairs = np.array([[[0, 1, 2], [0, 2, 3]], [[1, 2, 3], [1, 3, 0]]])
    least_round = [_least_round(flat, np.tile(pair, (len(flat), 1, 1))) for pair in pairs]
    return pairs[np.argmax(least_round, axis=0)]


def _clip_ears(flat: Float[np.ndarray, "m n 2"]) -> Int64[np.ndarray, "m t 3"]:
    """Triangles of simple polygons, of the roundest ear first; of others as many triangles with the same corners."""
    m, n, _ = flat.shape
    triangles = np.empty((m, n - 2, 3), np.int64)
    step = max(1, _TESTS_AT_ONCE // n**2)
    for start in range(0, m, step):
        part = flat[start : start + step]
        rows = np.arange(len(part))
        rest = np.tile(np.arange(n), (len(part), 1))
        for k in range(n, 3, -1):
            ear = _ear_quality(part[rows[:, None], rest]).argmax(axis=1)
            corners = np.stack([(ear - 1) % k, ear, (ear + 1) % k], axis=1)
            triangles[start : start + step, n - k] = rest[rows[:, None], corners]
            rest = rest[np.arange(k) != ear[:, None]].reshape(len(part), k - 1)
        triangles[start : start + step, n - 3] = rest
    return triangles


def _ear_quality(points: Float[np.ndarray, "m k 2"]) -> Float[np.ndarray, "m k"]:
    """How round the triangle at each corner is, from 0 to 1; less than 0 if it is no ear."""
    a, c = np.roll(points, 1, axis=1), np.roll(points, -1, axis=1)
    roundness = _roundness(a, points, c)
    holds_corner = np.ones((*points.shape[:2], points.shape[1]), bool)
    for p, q in ((a, points), (points, c), (c, a)):
        to_corner = points[:, None] - p[:, :, None]
        inside = _cross((q - p)[:, :, None], to_corner) >= -FLAT * np.linalg.norm(q - p, axis=2)[:, :, None]
        holds_corner &= inside & (to_corner != 0).any(axis=3)  # corners at the same place do not count
    return np.where(~holds_corner.any(axis=2) | (roundness <= 0), roundness, roundness - 2)
