"""Errors and times of estimators of Gaussian curvature, on surfaces where it is known."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from functools import partial

import igl
import numpy as np
import trimesh
from jaxtyping import Float, Int

from carigs.mesh.cotan_laplacian import CotanLaplacian, mixed_voronoi_areas
from carigs.mesh.curvature import angle_defects, diffuse_heat
from carigs.mesh.triangle_mesh import boundary_vertices, size
from evaluation.benchmarks.measurement.timing import Measurement, median_time


def measure_curvature(refinements: range) -> Iterator[Measurement]:
    """Measure the relative rms error and the time of estimators of Gaussian curvature where it is known.

    Args:
        refinements: Finenesses of the meshes.

    Yields:
        CPU times, and errors; the reference of an error is that of the previous mesh.
    """
    coarser: dict[tuple[str, str], float] = {}
    for n in refinements:
        for surface, (vertices, faces, truth) in _surfaces(n).items():
            areas = mixed_voronoi_areas(vertices, faces)
            for name, estimate in _estimators(vertices, faces).items():
                error = np.sqrt(np.average((estimate() - truth) ** 2, weights=areas))
                error = float(error / np.sqrt(np.average(truth**2, weights=areas)))
                case, seconds = f"{surface}, {len(vertices)} vertices", median_time(estimate, 3, time.process_time)
                yield Measurement(case, f"CPU: K: {name}", "s", seconds)
                yield Measurement(case, f"error of K: {name}", "1", error, coarser.get((surface, name)))
                coarser[surface, name] = error


def _surfaces(n: int) -> dict[str, tuple[np.ndarray, np.ndarray, np.ndarray]]:
    """Vertices, faces and true K at refinement n."""
    ball = trimesh.creation.icosphere(subdivisions=n)
    axes = np.array([1.0, 0.7, 1.4])
    points = np.asarray(ball.vertices) * axes
    # K = 1 / (a b c sum (x/a^2)^2)^2
    surfels_on_ellipsoid = 1 / (axes.prod() ** 2 * ((points / axes**2) ** 2).sum(axis=1) ** 2)
    surfaces = {"ellipsoid": (points, np.asarray(ball.faces), surfels_on_ellipsoid)}
    around, across = 16 * 2 ** (n - 1), 8 * 2 ** (n - 1)
    ring = trimesh.creation.torus(1.0, 0.4, major_sections=around, minor_sections=across)
    x, y, z = np.asarray(ring.vertices).T
    angles = np.stack([np.arctan2(y, x), np.arctan2(z, np.hypot(x, y) - 1.0)], axis=1)
    noise = np.random.default_rng(0).uniform(-0.2, 0.2, angles.shape) * 2 * np.pi / np.array([around, across])
    for name, (u, v) in {"torus": angles.T, "torus shaken by 20 % of an edge": (angles + noise).T}.items():
        reach = 1 + 0.4 * np.cos(v)
        points = np.stack([reach * np.cos(u), reach * np.sin(u), 0.4 * np.sin(v)], axis=1)
        surfaces[name] = points, np.asarray(ring.faces), np.cos(v) / (0.4 * reach)
    return surfaces


def _estimators(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]
) -> dict[str, Callable[[], Float[np.ndarray, " v"]]]:
    """Functions that estimate K from nothing but the mesh."""

    def defects() -> np.ndarray:
        return angle_defects(vertices, faces, boundary_vertices(faces, len(vertices)))

    def barycentric() -> np.ndarray:
        thirds = np.bincount(faces.ravel(), np.repeat(igl.doublearea(vertices, faces) / 6, 3), len(vertices))
        return defects() / thirds

    def diffused(share: float) -> np.ndarray:
        areas, duration = mixed_voronoi_areas(vertices, faces), (share * size(vertices, faces)) ** 2
        return diffuse_heat(defects() / areas, areas, CotanLaplacian(vertices, faces).stiffness(), duration)

    def quadric() -> np.ndarray:
        _, _, highest, lowest, *_ = igl.principal_curvature(vertices, faces)
        return highest * lowest

    return {
        "angle defect, mixed Voronoi": lambda: defects() / mixed_voronoi_areas(vertices, faces),
        "angle defect, barycentric": barycentric,
        **{heat_estimator(share): partial(diffused, share) for share in (0.005, 0.02)},
        "quadric fit (libigl)": quadric,
    }


def heat_estimator(share: float) -> str:
    """Name of the angle defect over mixed Voronoi cells after a heat step, in the records.

    Args:
        share: Value of `exaggerate.curvature_smoothing`.

    Returns:
        The name.
    """
    return f"the first, heat {100 * share:g} %"
