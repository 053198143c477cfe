"""Gaussian curvature at vertices: angle defect per mixed Voronoi area, smoothed by an implicit heat step."""

from __future__ import annotations

import igl
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csc_array, diags_array

from carigs.mesh.linear_solver import CholeskySolver, conjugate_gradients
from carigs.mesh.triangle_mesh import neighbour_pairs


def angle_defects(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], boundary: Bool[np.ndarray, " v"]
) -> Float[np.ndarray, " v"]:
    """Integrated Gaussian curvature at every vertex: 2 pi minus the sum of the corner angles.

    The discrete Gauss-Bonnet theorem holds exactly: the defects sum to 2 pi times the Euler characteristic of the
    surface (Meyer et al. 2003).

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles.
        boundary: Whether each vertex lies on the boundary.

    Returns:
        Angle defect in radians. On the boundary, where it is not a curvature, the value is pi minus the sum.
    """
    angles = igl.internal_angles(np.asarray(vertices, np.float64), np.asarray(faces, np.int64))
    angle_sums = np.bincount(faces.ravel(), angles.ravel(), len(vertices))
    return np.where(boundary, np.pi, 2 * np.pi) - angle_sums


def extrapolate(
    values: Float[np.ndarray, " v"], faces: Int[np.ndarray, "f 3"], unknown: Bool[np.ndarray, " v"]
) -> Float[np.ndarray, " v"]:
    """Replace unknown values by the mean of their known neighbours, one ring of vertices after the other.

    Args:
        values: A value at each vertex; unknown ones may hold anything.
        faces: Vertex indices of the triangles.
        unknown: Whether the value of each vertex is to be replaced.

    Returns:
        The completed values; 0 on components without a known value.
    """
    values, known = np.where(unknown, 0.0, values), ~unknown
    i, j = neighbour_pairs(faces)
    while not known.all():
        count = np.bincount(i, known[j], len(values))
        ring = ~known & (count > 0)
        if not ring.any():
            break
        total = np.bincount(i, np.where(known[j], values[j], 0.0), len(values))
        values[ring] = total[ring] / count[ring]
        known |= ring
    return values


def diffuse_heat(
    values: Float[np.ndarray, " v"], areas: Float[np.ndarray, " v"], stiffness: csc_array, time: float
) -> Float[np.ndarray, " v"]:
    """Smooth a function by one implicit step of the heat equation: (A + t W) y = A x (backward Euler).

    The integral over the surface does not change.

    Args:
        values: The function x at each vertex.
        areas: Area of each vertex's cell, the diagonal of A.
        stiffness: Cotan stiffness W (v, v).
        time: Duration t, in the unit of the areas; 0 returns the values as they are.

    Returns:
        The smoothed function y.
    """
    if time == 0:
        return values
    matrix, right = (diags_array(areas) + time * stiffness).tocsc(), areas * values
    # For short times conjugate gradients take a few dozen steps, at a fraction of the price of a factorisation.
    smooth = conjugate_gradients(matrix, right, values)
    return CholeskySolver(matrix).solve(right[:, None])[:, 0] if smooth is None else smooth


def gaussian_curvature(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    boundary: Bool[np.ndarray, " v"],
    areas: Float[np.ndarray, " v"],
    stiffness: csc_array,
    time: float,
) -> Float[np.ndarray, " v"]:
    """Gaussian curvature K: angle defect per area, extrapolated to the boundary, then smoothed by `diffuse_heat`.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles.
        boundary: Whether each vertex lies on the boundary.
        areas: Mixed Voronoi areas.
        stiffness: Cotan stiffness (v, v).
        time: Duration of the heat step, in the unit of the areas; 0 for none.

    Returns:
        K, in the unit of 1 / area.
    """
    curvature = extrapolate(angle_defects(vertices, faces, boundary) / areas, faces, boundary)
    return diffuse_heat(curvature, areas, stiffness, time)


def log_stabilized_curvature(
    curvature: Float[np.ndarray, " v"], areas: Float[np.ndarray, " v"], counted: Bool[np.ndarray, " v"], floor: float
) -> tuple[Float[np.ndarray, " v"], float]:
    """Logarithm of the stabilised curvature |K|_eps = sqrt(K^2 + eps^2) (paper, appendix), and of its reference.

    The paper leaves eps open. Here eps = floor * K_ref, where ln K_ref is the area mean of ln |K|, so that a change of
    the mesh's unit only adds a constant to the logarithm.

    Args:
        curvature: Gaussian curvature K.
        areas: Area of each vertex's cell.
        counted: Vertices over which the mean is taken.
        floor: eps in units of K_ref.

    Returns:
        ln |K|_eps at each vertex, and ln K_ref.
    """
    magnitude = np.abs(curvature)
    least = 1e-12 * magnitude[counted].max() + np.finfo(float).tiny
    log_reference = float(np.average(np.log(np.maximum(magnitude[counted], least)), weights=areas[counted]))
    return np.log(np.hypot(magnitude, floor * np.exp(log_reference))), log_reference
