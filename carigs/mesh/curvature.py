"""Gaussian curvature at vertices: angle defect over the mixed-Voronoi cell, smoothed by an implicit heat step."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csc_array, diags_array

from carigs.mesh.linear_solver import CholeskySolver, conjugate_gradients


def angle_defects(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], boundary: Bool[np.ndarray, " v"]
) -> Float[np.ndarray, " v"]:
    """2 pi (on the boundary pi) minus the angles around each vertex: they add up to 2 pi chi (Gauss-Bonnet)."""
    angles = igl.internal_angles(np.asarray(vertices, np.float64), np.asarray(faces, np.int64))
    around = np.bincount(faces.ravel(), angles.ravel(), len(vertices))
    return np.where(boundary, np.pi, 2 * np.pi) - around


def extrapolated(
    values: Float[np.ndarray, " v"], faces: Int[np.ndarray, "f 3"], unknown: Bool[np.ndarray, " v"]
) -> Float[np.ndarray, " v"]:
    """Replace unknown values by the mean of their known neighbours, ring by ring; 0 where nothing is known."""
    values, known = np.where(unknown, 0.0, values), ~unknown
    i, j = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    i, j = np.concatenate([i, j]), np.concatenate([j, i])
    while not known.all():
        count = np.bincount(i, known[j], len(values))
        ring = ~known & (count > 0)
        if not ring.any():
            break
        total = np.bincount(i, np.where(known[j], values[j], 0.0), len(values))
        values[ring] = total[ring] / count[ring]
        known |= ring
    return values


def heat_smoothed(
    values: Float[np.ndarray, " v"], areas: Float[np.ndarray, " v"], stiffness: csc_array, time: float
) -> Float[np.ndarray, " v"]:
    """One implicit step (M + t W) y = M x of the heat equation; keeps the integral.  `time` is a squared length."""
    if time == 0:
        return values
    matrix, right = (diags_array(areas) + time * stiffness).tocsc(), areas * values
    # Heat goes a few edges far: a few dozen steps of conjugate gradients, where factors would cost as much as a solve.
    smooth = conjugate_gradients(matrix, right, values)
    return CholeskySolver(matrix).solve(right[:, None])[:, 0] if smooth is None else smooth


def smooth_curvature(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    boundary: Bool[np.ndarray, " v"],
    areas: Float[np.ndarray, " v"],
    stiffness: csc_array,
    time: float,
) -> Float[np.ndarray, " v"]:
    """K in 1 / length^2: the angle defect per area, extrapolated to the boundary, smoothed for `time` (length^2)."""
    curvature = extrapolated(angle_defects(vertices, faces, boundary) / areas, faces, boundary)
    return heat_smoothed(curvature, areas, stiffness, time)


def log_magnitude(
    curvature: Float[np.ndarray, " v"], areas: Float[np.ndarray, " v"], counted: Bool[np.ndarray, " v"], floor: float
) -> tuple[Float[np.ndarray, " v"], float]:
    """Ln |K|_eps with eps = floor K_ref, and ln K_ref: the mean of ln |K| over the area of the `counted` vertices."""
    magnitude = np.abs(curvature)
    least = 1e-12 * magnitude[counted].max() + np.finfo(float).tiny
    log_reference = float(np.average(np.log(np.maximum(magnitude[counted], least)), weights=areas[counted]))
    return np.log(np.hypot(magnitude, floor * np.exp(log_reference))), log_reference
