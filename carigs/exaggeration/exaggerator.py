"""Curvature-weighted exaggeration: Lap S_gamma = div(|K|^gamma grad S), factorised once for all levels."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import csc_array

from carigs.errors import MeshError, SettingsError
from carigs.exaggeration.gamma_path import GammaPath, RegionPaths
from carigs.exaggeration.gap_stiffness import gap_stiffness
from carigs.exaggeration.local_edit import LocalEdit
from carigs.exaggeration.rigid_components import RigidComponent, find_rigid_components, follow
from carigs.exaggeration.solved_path import Solvable, solved_path
from carigs.exaggeration.whole import Whole
from carigs.mesh import triangle_mesh as mesh
from carigs.mesh.ambient_occlusion import cached_occlusion, smoothstep
from carigs.mesh.cotan_laplacian import CotanLaplacian, mixed_voronoi_areas
from carigs.mesh.curvature import log_magnitude, smooth_curvature
from carigs.mesh.linear_solver import COLUMNS
from carigs.mesh.pinned_solver import PinnedSystem
from carigs.mesh.regions import Regions
from carigs.settings import Exaggerate, check

CAVITY = (0.45, 0.75)
"""Hidden share of the hemisphere over which the limiter sets in."""


class Exaggerator:
    """Solves S_gamma of one mesh at any level: `solve(0.25)`, `path(0.25)`, `path(0.25, region="nose")`.

    The equation is solved in displacement form: with S_gamma = S + u it reads A u = -W_(w-1) S up to the common sign of
    W, so that level 0 (w = 1) gives u = 0 exactly.  A is the cotan stiffness W; the `robust` preset adds the stiffness
    of cavities and of narrow gaps.  Its null space, a constant per component, is fixed by keeping each component's
    area-weighted centroid (paper, equations 2 and 3; the least squares has zero residual).
    """

    def __init__(
        self,
        vertices: Float[np.ndarray, "v 3"],
        faces: Int[np.ndarray, "f 3"],
        settings: Exaggerate | None = None,
        *,
        regions: Mapping[str, np.ndarray] | None = None,
        mean: Float[np.ndarray, "v 3"] | None = None,
    ) -> None:
        """Assemble and factorise.

        Vertices are in any unit.  `regions` gives names to lists of vertices, masks or painted scalars, as
        `Regions.field` takes them.  `mean` is the face that the curvature is compared with when
        `settings.curvature_source` is `ratio`: other vertices of the same faces.  Raises `MeshError`, `SettingsError`
        for what cannot be used.
        """
        self.settings = settings or Exaggerate()
        check("exaggerate", self.settings)
        if self.settings.path_nodes == 1:
            raise SettingsError("exaggerate.path_nodes=1 must be 0, for as many as path_error needs, or 2 or more")
        mesh.check_mesh(np.asarray(vertices), np.asarray(faces))
        self.vertices, self.faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
        self.component = mesh.components(self.faces, len(self.vertices))
        self.areas = mixed_voronoi_areas(self.vertices, self.faces)
        self.face_areas = mesh.face_areas(self.vertices, self.faces)
        self._corners = np.ascontiguousarray(self.faces.T)
        self.size = mesh.size(self.vertices, self.faces)
        self.cotans = CotanLaplacian(self.vertices, self.faces)
        component_areas = np.bincount(self.component, self.areas)
        self.main = int(component_areas.argmax())
        every = np.ones(len(self.vertices), bool)
        self.solved = self.component == self.main if self.settings.rigid_components else every
        """Vertices that the equation moves; the others follow, and their curvature does not set the scale."""
        shares = np.where(self.solved[self.faces].all(axis=1), self.face_areas, 0.0)
        self._face_shares = shares / shares.sum()
        self.report: dict[str, Any] = {"components": len(component_areas)}
        boundary = mesh.boundary_vertices(self.faces, len(self.vertices))
        if (boundary | ~self.solved).all():
            raise MeshError("every vertex lies on the boundary: the curvature is defined nowhere")
        self.report["boundary_vertices"] = int(boundary.sum())
        stiffness = self.cotans.stiffness()
        self.regions = Regions(regions or {}, self.areas, stiffness, self.size)
        hidden = self._hidden()
        self.curvature = smooth_curvature(
            self.vertices,
            self.faces,
            boundary,
            self.areas,
            stiffness,
            (self.settings.curvature_smoothing * self.size) ** 2,
        )
        self.log_curvature = self._limited(self._logarithm(boundary, mean), hidden)
        """Of what is raised to the power gamma."""
        self.face_stiffness = 1 + self.settings.cavity_stiffness * self.face_mean(hidden)
        self.system = self._system(stiffness)
        """A, whose equation is solved: all vertices, not yet pinned."""

        self._pinned = PinnedSystem(self.system, self.component, self.solved, self.areas)
        self._divergence = self.cotans.divergence(self.vertices)
        self._edits: dict[str, LocalEdit] = {}

    def _hidden(self) -> Float[np.ndarray, " v"]:
        """1 in cavities, 0 where the surface is seen, smooth between."""
        if not self.settings.limit_cavities:
            return np.zeros(len(self.vertices))
        if mesh.signed_volume(self.vertices, self.faces[self.solved[self.faces].all(axis=1)]) < 0:
            raise MeshError("the faces are turned inwards, so that all looks hidden: reverse their corners")
        return smoothstep(cached_occlusion(self.vertices, self.faces, self.solved), *CAVITY)

    def _logarithm(self, boundary: np.ndarray, mean: np.ndarray | None) -> Float[np.ndarray, " v"]:
        """Ln |K|_eps, in units of K_ref or relative to the mean face's."""
        floor, solved = self.settings.curvature_floor, self.solved
        logarithm, reference = log_magnitude(self.curvature, self.areas, solved, floor)
        self.report["curvature_reference"] = float(np.exp(reference))
        if self.settings.curvature_source == "ratio":
            if mean is None or np.shape(mean) != self.vertices.shape:
                raise SettingsError("exaggerate.curvature_source=ratio needs a mean face of the same vertices")
            mean = np.asarray(mean, np.float64)
            mesh.check_mesh(mean, self.faces)
            areas, time = (
                mixed_voronoi_areas(mean, self.faces),
                (self.settings.curvature_smoothing * mesh.size(mean, self.faces)) ** 2,
            )
            curvature = smooth_curvature(
                mean, self.faces, boundary, areas, CotanLaplacian(mean, self.faces).stiffness(), time
            )
            usual, usual_reference = log_magnitude(curvature, areas, solved, floor)
            return (logarithm - reference) - (usual - usual_reference)
        return logarithm - reference if self.settings.relative_curvature else logarithm

    def _limited(self, logarithm: np.ndarray, hidden: np.ndarray) -> Float[np.ndarray, " v"]:
        """Nothing in a cavity grows."""
        limited = (1 - hidden) * logarithm + hidden * np.minimum(logarithm, 0)
        changed, solved = self.solved & (limited < logarithm - 1e-9), self.solved
        self.report["limited_vertices"] = int(changed.sum())
        self.report["limited_area"] = float(self.areas[changed].sum() / self.areas[solved].sum())
        self.report["log_curvature"] = [float(limited[solved].min()), float(limited[solved].max())]
        return limited

    def _system(self, stiffness: csc_array) -> csc_array:
        if (self.face_stiffness != 1).any():
            stiffness = self.cotans.stiffness(self.face_stiffness)
        if self.settings.gap_stiffness > 0:
            skin = self.faces[self.solved[self.faces].all(axis=1)]
            stiffness = (stiffness + self.settings.gap_stiffness * gap_stiffness(self.vertices, skin)).tocsc()
        return stiffness

    def weights(self, level: float, pace: np.ndarray | float = 1.0) -> Float[np.ndarray, " f"]:
        """W = |K|^(level pace) per face, the mean over its corners; `pace` may differ from vertex to vertex."""
        weights = self.face_mean(np.exp(level * pace * self.log_curvature))
        return weights / (self._face_shares @ weights) if self.settings.normalize_weights else weights

    def face_mean(self, values: Float[np.ndarray, " v"]) -> Float[np.ndarray, " f"]:
        """The mean over each face's corners."""
        a, b, c = self._corners
        return (values[a] + values[b] + values[c]) / 3

    def response(self, strain: Float[np.ndarray, " f"], x: np.ndarray | None = None) -> Float[np.ndarray, "v 3"]:
        """A^-1 W_strain x, without followers: what weights of 1 + strain add to x (default: the mesh itself).

        Linear in the strain and in `x` (v, 3), which may be an offset of the mesh such as a blendshape.
        """
        return self._pinned.solve(self.divergence(strain) if x is None else self.cotans.weighted_divergence(x, strain))

    def divergence(self, strain: Float[np.ndarray, " f"]) -> Float[np.ndarray, "v 3"]:
        """W_strain S of the mesh's own vertices."""
        return (self._divergence @ strain).reshape(-1, 3)

    def solve(self, level: float, levels: Mapping[str, float] | None = None) -> Float[np.ndarray, "v 3"]:
        """The displacement S_level - S, exactly zero at level 0; regions may have `levels` of their own."""
        return self.whole(level, levels).solve(level)

    def solve_many(self, levels: Sequence[float]) -> Float[np.ndarray, "k v 3"]:
        """`solve` at each of the levels: the factors are shared, a level costs three back-substitutions."""
        solved = np.zeros((len(levels), *self.vertices.shape))
        for start in range(0, len(levels), COLUMNS):  # so many, that the factors are used for full blocks of columns
            group = levels[start : start + COLUMNS]
            strains = np.stack([self.weights(level) - 1 for level in group], axis=1)
            right = (self._divergence @ strains).reshape(len(self.vertices), -1)
            together = self._pinned.solve(right).reshape(-1, 3, len(group))
            for k, level in enumerate(group):
                if level != 0:
                    solved[start + k] = self.with_followers(together[..., k])
        return solved

    def path(
        self,
        gamma_f: float,
        *,
        region: str | np.ndarray | Sequence[int] | None = None,
        levels: Mapping[str, float] | None = None,
    ) -> GammaPath:
        """S_gamma for all levels from 0 to gamma_f, solved exactly at as many nodes as `settings.path_error` needs.

        With `region` (as `Regions.field` takes it) that region alone is exaggerated and the rest is held.  With
        `levels` the head is exaggerated and the named regions have levels of their own where the rest has gamma_f, in
        the same proportion along the path.
        """
        if region is not None:
            return self.local(region).path(gamma_f)
        return solved_path(self.whole(gamma_f, levels), gamma_f, self)

    def whole(self, gamma_f: float, levels: Mapping[str, float] | None = None) -> Solvable:
        """The whole head on its way to gamma_f, its regions to `levels` of their own."""
        return Whole(self, gamma_f, levels)

    def local(self, region: str | np.ndarray | Sequence[int]) -> LocalEdit:
        """The exaggeration of one region while the rest is held; of a name it is factorised once."""
        if not isinstance(region, str):
            return LocalEdit(self, region)
        if region not in self._edits:
            self._edits[region] = LocalEdit(self, region)
        return self._edits[region]

    def region_paths(self, gamma_f: float, names: Sequence[str] | None = None) -> RegionPaths:
        """Independent sliders: a path for each of the named regions (default: all), which add up without a solve.

        The equation's right-hand side is a sum over the faces, so disjoint regions do not know of each other.
        """
        return RegionPaths({name: self.path(gamma_f, region=name) for name in names or self.regions.named})

    @cached_property
    def followers(self) -> list[RigidComponent]:
        """The small components, in groups; none where the equation moves all."""
        if not self.settings.rigid_components:
            return []
        return find_rigid_components(self.vertices, self.faces, self.component, self.main)

    def with_followers(
        self, displacement: Float[np.ndarray, "v 3"], followers: Sequence[RigidComponent] | None = None
    ) -> Float[np.ndarray, "v 3"]:
        """The displacement of the solved vertices, and of the small components by similarities of those around.

        `followers` are those that follow (default: all); the others stay.
        """
        followers = self.followers if followers is None else followers
        if followers:
            displacement, self.report["follower_scales"] = follow(self.vertices, displacement, followers)
        return displacement
