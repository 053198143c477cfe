"""Curvature-weighted exaggeration: Lap S_gamma = div(|K|^gamma grad S), factorised once for all levels."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse.linalg import splu

from carigs.settings import Exaggerate
from carigs.surface.curvature import angle_defects, extrapolated, heat_smoothed
from carigs.surface.followers import follow
from carigs.surface.mesh import boundary_vertices, check_mesh, components, face_areas, size
from carigs.surface.occlusion import ambient_occlusion, smoothstep
from carigs.surface.operators import EdgeCotans, mixed_voronoi_areas
from carigs.surface.path import GammaPath

CAVITY = (0.45, 0.75)  # hidden share of the hemisphere over which the limiter sets in


class Exaggerator:
    """Solves S_gamma of one mesh at any level.

    The equation is solved in displacement form: with S_gamma = S + u it reads W u = -W_(w-1) S up to the common sign of
    W, so that level 0 (w = 1) gives u = 0 exactly.  Its null space, a constant per component, is fixed by keeping each
    component's area-weighted centroid (paper, equations 2 and 3; the least squares has zero residual).
    """

    def __init__(
        self, vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], settings: Exaggerate | None = None
    ) -> None:
        """Factorise; vertices are in any unit.  Raises `MeshError` for a mesh that cannot be used."""
        self.settings = settings or Exaggerate()
        self.vertices, self.faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
        check_mesh(self.vertices, self.faces)
        self.component = components(self.faces, len(self.vertices))
        self.areas = mixed_voronoi_areas(self.vertices, self.faces)
        component_areas = np.bincount(self.component, self.areas)
        self.main = int(component_areas.argmax())
        self.cotans = EdgeCotans(self.vertices, self.faces)
        self.face_areas = face_areas(self.vertices, self.faces)
        self.report: dict[str, Any] = {"components": len(component_areas)}
        self.curvature, self.log_curvature = self._curvatures()

        # One vertex of each component is pinned; the others' system is symmetric positive definite.
        pinned = np.unique(self.component, return_index=True)[1]
        self._free = np.setdiff1d(np.arange(len(self.vertices)), pinned)
        self._factors = splu(self.cotans.stiffness()[self._free][:, self._free].tocsc())

    def _counted(self) -> np.ndarray:
        """Vertices whose curvature sets the scale: followers do not."""
        return self.component == self.main if self.settings.followers else np.ones(len(self.vertices), bool)

    def _curvatures(self) -> tuple[Float[np.ndarray, " v"], Float[np.ndarray, " v"]]:
        """K and the logarithm of what is raised to the power gamma."""
        boundary = boundary_vertices(self.faces, len(self.vertices))
        defects = angle_defects(self.vertices, self.faces, boundary)
        curvature = extrapolated(defects / self.areas, self.faces, boundary)
        time = (self.settings.heat * size(self.vertices, self.faces)) ** 2
        curvature = heat_smoothed(curvature, self.areas, self.cotans.stiffness(), time)

        counted, magnitude = self._counted(), np.abs(curvature)
        floor = 1e-12 * magnitude[counted].max() + np.finfo(float).tiny
        log_reference = np.average(np.log(np.maximum(magnitude[counted], floor)), weights=self.areas[counted])
        reference = np.exp(log_reference)  # K_ref, the geometric mean
        stabilised = np.log(np.hypot(magnitude, self.settings.curvature_floor * reference))
        if self.settings.relative_curvature:
            stabilised = stabilised - log_reference
        self.report |= {"curvature_reference": float(reference)}
        if self.settings.limit_cavities:
            hidden = smoothstep(ambient_occlusion(self.vertices, self.faces), *CAVITY)
            limited = (1 - hidden) * stabilised + hidden * np.minimum(stabilised, 0)
            self.report["limited_vertices"] = int((limited < stabilised - 1e-9).sum())
            stabilised = limited
        return curvature, stabilised

    def weights(self, level: float) -> Float[np.ndarray, " f"]:
        """w = |K|^level per face, the mean over its corners."""
        weights = np.exp(level * self.log_curvature)[self.faces].mean(axis=1)
        if self.settings.normalise:
            counted = self._counted()[self.faces].all(axis=1)
            weights = weights / np.average(weights[counted], weights=self.face_areas[counted])
        return weights

    def solve(self, level: float) -> Float[np.ndarray, "v 3"]:
        """The displacement S_level - S, exactly zero at level 0."""
        if level == 0:
            return np.zeros_like(self.vertices)
        divergence = self.cotans.weighted_divergence(self.vertices, self.weights(level) - 1)
        displacement = np.zeros_like(self.vertices)
        displacement[self._free] = self._factors.solve(divergence[self._free])
        for c in range(self.report["components"]):
            inside = self.component == c
            displacement[inside] -= np.average(displacement[inside], axis=0, weights=self.areas[inside])
        if self.settings.followers:
            displacement, scales = follow(self.vertices, displacement, self.component, self.main)
            self.report["follower_scales"] = scales
        return displacement

    def path(self, gamma_f: float) -> GammaPath:
        """S_gamma for all levels in [0, gamma_f], solved exactly at the nodes of the settings."""
        levels = gamma_f * np.asarray(self.settings.nodes, np.float64)
        displacements = np.stack([self.solve(level) for level in levels]).astype(np.float32)
        report = {
            "source": "poisson",
            "settings": {**asdict(self.settings), "nodes": list(self.settings.nodes)},
            **self.report,
            "largest_displacement": float(np.abs(displacements[-1]).max()),
        }
        return GammaPath(levels, displacements, self.faces, self.vertices, report)
