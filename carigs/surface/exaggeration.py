"""Curvature-weighted exaggeration: Lap S_gamma = div(|K|^gamma grad S), factorised once for all levels."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse.linalg import splu

from carigs.errors import MeshError, SettingsError
from carigs.settings import Exaggerate
from carigs.surface.curvature import angle_defects, extrapolated, heat_smoothed
from carigs.surface.followers import follow
from carigs.surface.mesh import boundary_vertices, check_mesh, components, face_areas, signed_volume, size
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
        """Factorise; vertices are in any unit.  Raises `MeshError`, `SettingsError` for what cannot be used."""
        self.settings = settings or Exaggerate()
        _check(self.settings)
        check_mesh(np.asarray(vertices), np.asarray(faces))
        self.vertices, self.faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
        self.component = components(self.faces, len(self.vertices))
        self.areas = mixed_voronoi_areas(self.vertices, self.faces)
        component_areas = np.bincount(self.component, self.areas)
        self.main = int(component_areas.argmax())
        self.cotans = EdgeCotans(self.vertices, self.faces)
        self.face_areas = face_areas(self.vertices, self.faces)
        every = np.ones(len(self.vertices), bool)
        self.solved = self.component == self.main if self.settings.followers else every
        """Vertices that the equation moves; the others follow, and their curvature does not set the scale."""
        self.report: dict[str, Any] = {"components": len(component_areas)}
        self.curvature, self.log_curvature = self._curvatures()

        # One vertex of each component is pinned; the others' system is symmetric positive definite.
        pinned = np.unique(self.component, return_index=True)[1]
        self._free = np.setdiff1d(np.arange(len(self.vertices)), pinned)
        self._factors = splu(self.cotans.stiffness()[self._free][:, self._free].tocsc())

    def _curvatures(self) -> tuple[Float[np.ndarray, " v"], Float[np.ndarray, " v"]]:
        """K and the logarithm of what is raised to the power gamma."""
        boundary = boundary_vertices(self.faces, len(self.vertices))
        if (boundary | ~self.solved).all():
            raise MeshError("every vertex lies on the boundary: the curvature is defined nowhere")
        defects = angle_defects(self.vertices, self.faces, boundary)
        curvature = extrapolated(defects / self.areas, self.faces, boundary)
        time = (self.settings.heat * size(self.vertices, self.faces)) ** 2
        curvature = heat_smoothed(curvature, self.areas, self.cotans.stiffness(), time)

        solved, magnitude = self.solved, np.abs(curvature)
        floor = 1e-12 * magnitude[solved].max() + np.finfo(float).tiny
        log_reference = np.average(np.log(np.maximum(magnitude[solved], floor)), weights=self.areas[solved])
        reference = np.exp(log_reference)  # K_ref, the geometric mean
        stabilised = np.log(np.hypot(magnitude, self.settings.curvature_floor * reference))
        if self.settings.relative_curvature:
            stabilised = stabilised - log_reference
        self.report |= {"boundary_vertices": int(boundary.sum()), "curvature_reference": float(reference)}
        if self.settings.limit_cavities:
            if signed_volume(self.vertices, self.faces[self.solved[self.faces].all(axis=1)]) < 0:
                raise MeshError("the faces are turned inwards, so that all looks hidden: reverse their corners")
            hidden = smoothstep(ambient_occlusion(self.vertices, self.faces, at=solved), *CAVITY)
            limited = (1 - hidden) * stabilised + hidden * np.minimum(stabilised, 0)
            changed = solved & (limited < stabilised - 1e-9)
            self.report["limited_vertices"] = int(changed.sum())
            self.report["limited_area"] = float(self.areas[changed].sum() / self.areas[solved].sum())
            stabilised = limited
        self.report["log_curvature"] = [float(stabilised[solved].min()), float(stabilised[solved].max())]
        return curvature, stabilised

    def weights(self, level: float) -> Float[np.ndarray, " f"]:
        """w = |K|^level per face, the mean over its corners."""
        weights = np.exp(level * self.log_curvature)[self.faces].mean(axis=1)
        if self.settings.normalise:
            solved = self.solved[self.faces].all(axis=1)
            weights = weights / np.average(weights[solved], weights=self.face_areas[solved])
        return weights

    def response(
        self, strain: Float[np.ndarray, " f"], x: Float[np.ndarray, "v 3"] | None = None
    ) -> Float[np.ndarray, "v 3"]:
        """W^-1 W_strain x, without followers: what weights of 1 + strain add to x (default: the mesh itself).

        Linear in the strain and in x, which may be a motion of the mesh such as a blendshape.
        """
        divergence = self.cotans.weighted_divergence(self.vertices if x is None else x, strain)
        u = np.zeros_like(self.vertices)
        u[self._free] = self._factors.solve(divergence[self._free])
        for c in range(self.report["components"]):
            inside = self.component == c
            u[inside] -= np.average(u[inside], axis=0, weights=self.areas[inside])
        return u

    def solve(self, level: float) -> Float[np.ndarray, "v 3"]:
        """The displacement S_level - S, exactly zero at level 0."""
        if level == 0:
            return np.zeros_like(self.vertices)
        displacement = self.response(self.weights(level) - 1)
        if self.settings.followers:
            displacement, scales = follow(self.vertices, displacement, self.component, self.main)
            self.report["follower_scales"] = scales
        return displacement

    def solve_many(self, levels: Sequence[float]) -> Float[np.ndarray, "k v 3"]:
        """`solve` at each of the levels: the factors are shared, a level costs three back-substitutions."""
        # All right-hand sides in one call would be slower: SuperLU's solve is at its best with up to four columns.
        return np.stack([self.solve(float(level)) for level in levels])

    def path(self, gamma_f: float) -> GammaPath:
        """S_gamma for all levels in [0, gamma_f], solved exactly at the nodes of the settings."""
        if not gamma_f > 0:
            raise SettingsError(f"gamma={gamma_f:g}: a path needs a level above 0")
        levels = gamma_f * np.asarray(self.settings.nodes, np.float64)
        displacements = self.solve_many(levels).astype(np.float32)
        report = {
            "source": "poisson",
            "settings": {**asdict(self.settings), "nodes": list(self.settings.nodes)},
            **self.report,
            "largest_displacement": float(np.abs(displacements[-1]).max()),
        }
        return GammaPath(levels, displacements, self.faces, self.vertices, report)


def _check(settings: Exaggerate) -> None:
    """What the types of the settings cannot say."""
    if not 0 < settings.curvature_floor < np.inf:
        raise SettingsError(f"exaggerate.curvature_floor={settings.curvature_floor:g} must be above 0")
    if not 0 <= settings.heat < np.inf:
        raise SettingsError(f"exaggerate.heat={settings.heat:g} must not be negative")
    nodes = np.asarray(settings.nodes, np.float64)
    if len(nodes) < 2 or nodes[0] != 0 or nodes[-1] != 1 or not (np.diff(nodes) > 0).all():
        raise SettingsError(f"exaggerate.nodes={list(settings.nodes)} must ascend from 0 to 1")
