"""The curvature-weighted Poisson equation on a triangle mesh, discretised with the cotan Laplacian."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csc_array

from carigs.errors import MeshError, SettingsError
from carigs.exaggeration.gap_stiffness import gap_stiffness
from carigs.exaggeration.rigid_components import RigidComponent, find_rigid_components, move_rigid_components
from carigs.mesh.ambient_occlusion import cached_ambient_occlusion
from carigs.mesh.cotan_laplacian import CotanLaplacian, mixed_voronoi_areas
from carigs.mesh.curvature import gaussian_curvature, log_stabilized_curvature
from carigs.mesh.linear_solver import PoissonSolver
from carigs.mesh.regions import Regions
from carigs.mesh.smoothstep import smoothstep
from carigs.mesh.triangle_mesh import boundary_vertices, components, face_areas, signed_volume, size
from carigs.mesh.validation import check_mesh
from carigs.settings import Exaggerate, check

CAVITY_OCCLUSION = (0.45, 0.75)
"""Ambient occlusion at which a vertex begins to count as part of a cavity, and at which it fully does."""
CAVITY_STIFFNESS = 4.0
"""Additional stiffness of triangles in cavities, relative to open skin, against folding."""
MAX_WEIGHT = 1e100
"""Largest weight of a face: squares and products of weights must stay finite in float64."""


class WeightedPoisson:
    """The equation Lap S_gamma = div(w(gamma) grad S) of one mesh S, assembled and factorised once for all weights.

    Paper, equations 1 and 2, with the weights w(gamma) = |K|^gamma of the Gaussian curvature K:

        Lap S_gamma = div(|K|^gamma grad S).

    Paper, equation 3, discretises it as the least squares

        min |L x~ - b|_A^2,    L = A^-1 W,    b = A^-1 W_w x,

    with the vertices x of S, the cotan stiffness W, its weighted form W_w, and the vertex areas A. The minimum is 0, at
    W x~ = W_w x. With x~ = x + u the equation takes the displacement form

        W u = W_(w - 1) x,

    which gives exactly u = 0 at level 0 (w = 1). The null space of W, a constant per connected component, is fixed by
    keeping the area-weighted centroid of each component. The preset `robust` replaces W on the left by `system`, which
    adds the stiffness of cavities and of narrow gaps.
    """

    def __init__(
        self,
        vertices: Float[np.ndarray, "v 3"],
        faces: Int[np.ndarray, "f 3"],
        settings: Exaggerate | None = None,
        *,
        regions: Mapping[str, np.ndarray] | None = None,
        mean_face: Float[np.ndarray, "v 3"] | None = None,
    ) -> None:
        """Assemble and factorise.

        Args:
            vertices: Positions of the neutral surface S, in any unit.
            faces: Vertex indices of the triangles, counterclockwise seen from outside.
            settings: Options; None for the defaults (the preset `robust`).
            regions: Regions by name: vertex indices, masks or painted scalars, as `vertex_field` takes them.
            mean_face: Vertices of a mean face with the same triangles, in any unit. Required if
                `settings.curvature_source` is `ratio`.

        Raises:
            MeshError: If the mesh cannot be solved on; see `check_mesh`.
            SettingsError: If a setting is out of range or the mean face is missing.
        """
        self.settings = settings or Exaggerate()
        check("exaggerate", self.settings)
        if self.settings.path_nodes == 1:
            raise SettingsError("exaggerate.path_nodes=1 must be 0, for as many as the path needs, or 2 or more")
        check_mesh(np.asarray(vertices), np.asarray(faces))
        self.vertices, self.faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
        self.component_labels = components(self.faces, len(self.vertices))
        self.areas = mixed_voronoi_areas(self.vertices, self.faces)
        self.face_areas = face_areas(self.vertices, self.faces)
        self._corners = np.ascontiguousarray(self.faces.T)
        self.size = size(self.vertices, self.faces)
        self.laplacian = CotanLaplacian(self.vertices, self.faces)
        component_areas = np.bincount(self.component_labels, self.areas)
        self.main_component = int(component_areas.argmax())
        all_vertices = np.ones(len(self.vertices), bool)
        self.solved_vertices: Bool[np.ndarray, " v"] = (
            self.component_labels == self.main_component if self.settings.rigid_components else all_vertices
        )
        """Vertices that the equation moves. The others move rigidly, and their curvature does not count in K_ref."""
        self.solved_faces: Bool[np.ndarray, " f"] = self.solved_vertices[self.faces].all(axis=1)
        area_shares = np.where(self.solved_faces, self.face_areas, 0.0)
        self._area_shares = area_shares / area_shares.sum()
        boundary = boundary_vertices(self.faces, len(self.vertices))
        if (boundary | ~self.solved_vertices).all():
            raise MeshError("every vertex lies on the boundary: the curvature is defined nowhere")
        self.report: dict[str, Any] = {"components": len(component_areas), "boundary_vertices": int(boundary.sum())}
        stiffness = self.laplacian.stiffness()
        self.regions = Regions(regions or {}, self.areas, stiffness, self.size)
        cavity = self._cavity()
        log_curvature = self._log_curvature(boundary, stiffness, mean_face)
        self.log_curvature: Float[np.ndarray, " v"] = self._limit_in_cavities(log_curvature, cavity)
        """Logarithm of what is raised to the power gamma."""
        self.face_stiffness = 1 + CAVITY_STIFFNESS * self.face_mean(cavity)
        self.system: csc_array = self._assemble_system(stiffness)
        """Matrix of the equation for all vertices, before pinning."""
        self._solver = PoissonSolver(self.system, self.component_labels, self.solved_vertices, self.areas)
        self._divergence = self.laplacian.divergence_matrix(self.vertices)

    def weights(self, level: float, rate: Float[np.ndarray, " v"] | float = 1.0) -> Float[np.ndarray, " f"]:
        """Weights w(gamma) = |K|^gamma of the faces (paper, equation 2): the mean over the corners.

        With `settings.normalize_weights` they are divided by their area mean, which keeps the size of the head.

        Args:
            level: Exaggeration gamma.
            rate: Factor on the level at each vertex, for regions with levels of their own.

        Returns:
            Weight of each face; 1 at level 0.

        Raises:
            SettingsError: If a weight is not finite or is larger than `MAX_WEIGHT`.
        """
        weights = self.curvature_power(level * rate)
        return weights / (self._area_shares @ weights) if self.settings.normalize_weights else weights

    def curvature_power(self, exponent: Float[np.ndarray, " v"] | float) -> Float[np.ndarray, " f"]:
        """Mean of |K|^exponent over the corners of each face.

        Args:
            exponent: Exponent, or one for each vertex.

        Returns:
            A value for each face; 1 at exponent 0.

        Raises:
            SettingsError: If a value is not finite or is larger than `MAX_WEIGHT`.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            weights = self.face_mean(np.exp(exponent * self.log_curvature))
        if not (weights <= MAX_WEIGHT).all():
            level = float(np.max(np.abs(exponent)))
            raise SettingsError(f"level {level:g}: a weight |K|^gamma exceeds {MAX_WEIGHT:g}: use a level nearer to 0")
        return weights

    def face_mean(self, values: Float[np.ndarray, " v"]) -> Float[np.ndarray, " f"]:
        """Mean of a function over the corners of each face.

        Args:
            values: A value at each vertex.

        Returns:
            A value for each face.
        """
        a, b, c = self._corners
        return (values[a] + values[b] + values[c]) / 3

    def weighted_divergence(self, delta_weights: Float[np.ndarray, " f"]) -> Float[np.ndarray, "v 3"]:
        """Right-hand side W_(w - 1) x of the displacement form, for the vertices x of the mesh.

        Args:
            delta_weights: w - 1 of each face.

        Returns:
            The product, in the unit of the mesh.
        """
        return (self._divergence @ delta_weights).reshape(-1, 3)

    def response(
        self, delta_weights: Float[np.ndarray, " f"], x: Float[np.ndarray, "v 3"] | None = None
    ) -> Float[np.ndarray, "v 3"]:
        """Solve the displacement form W u = W_(w - 1) x; linear in the weights and in x.

        Args:
            delta_weights: w - 1 of each face.
            x: A function on the vertices, for example a blendshape. None for the vertices of the mesh.

        Returns:
            u at the solved vertices, with the unit of x; 0 at the rigid components.
        """
        return self._solver.solve(
            self.weighted_divergence(delta_weights)
            if x is None
            else self.laplacian.weighted_divergence(x, delta_weights)
        )

    @cached_property
    def rigid_components(self) -> list[RigidComponent]:
        """Groups of small components that move by a similarity; empty if the equation moves all vertices."""
        if not self.settings.rigid_components:
            return []
        return find_rigid_components(self.vertices, self.faces, self.component_labels, self.main_component)

    def move_rigid_components(
        self, displacement: Float[np.ndarray, "v 3"], rigid_components: Sequence[RigidComponent] | None = None
    ) -> Float[np.ndarray, "v 3"]:
        """Add the displacement of the small components to that of the solved vertices.

        Args:
            displacement: Displacement of the solved vertices.
            rigid_components: Components that move (None: all); the others stay.

        Returns:
            Displacement of all vertices.
        """
        rigid_components = self.rigid_components if rigid_components is None else rigid_components
        if rigid_components:
            displacement, self.report["follower_scales"] = move_rigid_components(
                self.vertices, displacement, rigid_components
            )
        return displacement

    def _cavity(self) -> Float[np.ndarray, " v"]:
        """1 in cavities, 0 where the surface is exposed, smooth in between."""
        if not self.settings.limit_cavities:
            return np.zeros(len(self.vertices))
        if signed_volume(self.vertices, self.faces[self.solved_faces]) < 0:
            raise MeshError("the faces are turned inwards, so that all looks hidden: reverse their corners")
        occlusion = cached_ambient_occlusion(self.vertices, self.faces, self.solved_vertices)
        return smoothstep(occlusion, *CAVITY_OCCLUSION)

    def _log_curvature(
        self, boundary: Bool[np.ndarray, " v"], stiffness: csc_array, mean_face: np.ndarray | None
    ) -> Float[np.ndarray, " v"]:
        """Ln |K|_eps, in units of K_ref or relative to the mean face."""

        def log_curvature(vertices: np.ndarray, areas: np.ndarray, stiffness: csc_array, extent: float):
            time = (self.settings.curvature_smoothing * extent) ** 2
            curvature = gaussian_curvature(vertices, self.faces, boundary, areas, stiffness, time)
            return log_stabilized_curvature(curvature, areas, self.solved_vertices, self.settings.curvature_floor)

        log_own, log_reference = log_curvature(self.vertices, self.areas, stiffness, self.size)
        self.report["curvature_reference"] = float(np.exp(log_reference))
        if self.settings.curvature_source == "ratio":
            if mean_face is None or np.shape(mean_face) != self.vertices.shape:
                raise SettingsError("exaggerate.curvature_source=ratio needs a mean face of the same vertices")
            mean_face = np.asarray(mean_face, np.float64)
            check_mesh(mean_face, self.faces)
            log_mean, log_mean_reference = log_curvature(
                mean_face,
                mixed_voronoi_areas(mean_face, self.faces),
                CotanLaplacian(mean_face, self.faces).stiffness(),
                size(mean_face, self.faces),
            )
            return (log_own - log_reference) - (log_mean - log_mean_reference)
        return log_own - log_reference if self.settings.normalize_weights else log_own

    def _limit_in_cavities(
        self, log_curvature: Float[np.ndarray, " v"], cavity: Float[np.ndarray, " v"]
    ) -> Float[np.ndarray, " v"]:
        """Limit ln |K| to 0 in cavities, where the surface would otherwise grow through itself."""
        limited = (1 - cavity) * log_curvature + cavity * np.minimum(log_curvature, 0)
        solved = self.solved_vertices
        changed = solved & (limited < log_curvature - 1e-9)
        self.report["limited_vertices"] = int(changed.sum())
        self.report["limited_area"] = float(self.areas[changed].sum() / self.areas[solved].sum())
        self.report["log_curvature"] = [float(limited[solved].min()), float(limited[solved].max())]
        return limited

    def _assemble_system(self, stiffness: csc_array) -> csc_array:
        """Stiffness matrix of the left-hand side: W_s with the face stiffness s, and the stiffness of narrow gaps."""
        if (self.face_stiffness != 1).any():
            stiffness = self.laplacian.stiffness(self.face_stiffness)
        if self.settings.gap_stiffness > 0:
            gaps = gap_stiffness(self.vertices, self.faces[self.solved_faces])
            stiffness = (stiffness + self.settings.gap_stiffness * gaps).tocsc()
        return stiffness
