"""Exaggeration of a mesh at any level: exact solves, paths over the level, regions with levels of their own."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from functools import cached_property

import numpy as np
from jaxtyping import Float

from carigs.errors import SettingsError
from carigs.exaggeration.gamma_path import GammaPath, barycentric_weights, lagrange_weights, lobatto_levels
from carigs.exaggeration.local_edit import LocalEdit
from carigs.exaggeration.region_paths import RegionPaths
from carigs.exaggeration.weighted_poisson import WeightedPoisson
from carigs.mesh.linear_solver import COLUMNS
from carigs.mesh.regions import partition_of_unity
from carigs.mesh.triangle_mesh import diagonal

PATH_ERROR = 1e-4
"""Largest interpolation error of a path between its nodes, in bounding-box diagonals; it determines their number."""
MAX_TRIED_NODES = 12
"""Largest number of nodes that is tried for a path."""

LevelWeights = Callable[[float], Float[np.ndarray, " f"]]
Response = Callable[[Float[np.ndarray, " f"]], Float[np.ndarray, "v 3"]]


class Exaggerator(WeightedPoisson):
    """Solves for the caricature S_gamma of one mesh at any level gamma; see `WeightedPoisson` for the equation.

    Example:
        >>> exaggerator = Exaggerator(vertices, faces, regions={"nose": nose_vertices})
        >>> caricature = vertices + exaggerator.solve(0.25)
        >>> path = exaggerator.path(0.25)                       # all levels up to 0.25 without further solves
        >>> nose_path = exaggerator.path(0.4, region="nose")    # the nose alone
    """

    def solve(self, level: float, levels: Mapping[str, float] | None = None) -> Float[np.ndarray, "v 3"]:
        """Solve for the displacement S_gamma - S of one level (paper, equations 1 to 3).

        Args:
            level: Exaggeration gamma.
            levels: Levels of regions by name, where they differ from `level`.

        Returns:
            Displacement in the unit of the mesh; exactly 0 at level 0.

        Raises:
            SettingsError: If a region is unknown, or `levels` are given at level 0.
        """
        return self._solve(level, self.level_rates(level, levels))

    def solve_many(self, levels: Sequence[float]) -> Float[np.ndarray, "k v 3"]:
        """Solve for several levels; each costs three back-substitutions.

        Args:
            levels: Exaggerations gamma.

        Returns:
            Displacement at each level, as `solve`.
        """
        displacements = np.zeros((len(levels), *self.vertices.shape))
        for start in range(0, len(levels), COLUMNS):  # fills the blocks of columns that the solver works on
            group = levels[start : start + COLUMNS]
            delta_weights = np.stack([self.weights(level) - 1 for level in group], axis=1)
            right = (self._divergence @ delta_weights).reshape(len(self.vertices), -1)
            solutions = self._solver.solve(right).reshape(-1, 3, len(group))
            for k, level in enumerate(group):
                if level != 0:
                    displacements[start + k] = self.move_rigid_components(solutions[..., k])
        return displacements

    def path(
        self,
        gamma_f: float,
        *,
        region: str | np.ndarray | Sequence[int] | None = None,
        levels: Mapping[str, float] | None = None,
    ) -> GammaPath:
        """Solve at the nodes of a path: S_gamma at all levels from 0 to gamma_f by interpolation.

        Args:
            gamma_f: Level at the end of the path; may be negative.
            region: If given, this region alone is exaggerated and the rest is held (`LocalEdit`): a name or anything
                that `Regions.field` takes.
            levels: Levels that the named regions have at the end of the path; along the path they stay in proportion.

        Returns:
            The path, with as many nodes as `PATH_ERROR` requires or `settings.path_nodes` sets.

        Raises:
            SettingsError: If gamma_f is 0 or not finite, or a region is unknown.
        """
        if region is not None:
            edit = self.local_edit(region)
            return self._interpolated_path(gamma_f, edit.weights, edit.response, edit.solve)
        rates = self.level_rates(gamma_f, levels)
        return self._interpolated_path(
            gamma_f, lambda level: self.weights(level, rates), self.response, lambda level: self._solve(level, rates)
        )

    def level_rates(self, gamma_f: float, levels: Mapping[str, float] | None) -> Float[np.ndarray, " v"] | float:
        """Factor on the level at each vertex, for regions with levels of their own.

        Args:
            gamma_f: Level of the rest of the head.
            levels: Levels of regions by name; overlapping regions share.

        Returns:
            Level of the vertex divided by gamma_f; 1 without regions.

        Raises:
            SettingsError: If a region is unknown, a level is not finite, or gamma_f is 0 although there are regions.
        """
        if not levels:
            return 1.0
        if not np.isfinite(list(levels.values())).all():
            raise SettingsError(f"levels of regions must be numbers, found {dict(levels)}")
        if gamma_f == 0:
            raise SettingsError(
                f"levels of regions ({', '.join(levels)}) need a head at a level other than 0: set another gamma, or "
                "exaggerate the regions alone (`Exaggerator.region_paths`, or `carigs mesh --gamma 0`)"
            )
        shares = partition_of_unity(np.stack([self.regions.field(name) for name in levels]))
        return 1 + (np.array(list(levels.values())) / gamma_f - 1) @ shares

    def local_edit(self, region: str | np.ndarray | Sequence[int]) -> LocalEdit:
        """Prepare the exaggeration of one region while the rest is held.

        Args:
            region: A name (then the factorisation is kept), or anything that `Regions.field` takes.

        Returns:
            The factorised edit.

        Raises:
            SettingsError: If the region is unknown or not valid.
        """
        if not isinstance(region, str):
            return LocalEdit(self, region)
        if region not in self._edits:
            self._edits[region] = LocalEdit(self, region)
        return self._edits[region]

    def region_paths(self, gamma_f: float, names: Sequence[str] | None = None) -> RegionPaths:
        """Solve the paths of independent region sliders.

        The right-hand side of the equation is a sum over the faces, so the displacements of disjoint regions add up.

        Args:
            gamma_f: Level at the end of each path.
            names: Names of regions; None for all.

        Returns:
            A path for each region.

        Raises:
            SettingsError: If a region is unknown.
        """
        return RegionPaths({name: self.path(gamma_f, region=name) for name in names or self.regions.named})

    @cached_property
    def _edits(self) -> dict[str, LocalEdit]:
        """Factorised edits of named regions."""
        return {}

    def _solve(self, level: float, rates: Float[np.ndarray, " v"] | float) -> Float[np.ndarray, "v 3"]:
        """Displacement at a level, with the factors of `level_rates`."""
        if level == 0:
            return np.zeros_like(self.vertices)
        return self.move_rigid_components(self.response(self.weights(level, rates) - 1))

    def _interpolated_path(
        self, gamma_f: float, weights: LevelWeights, response: Response, solve: Callable[[float], np.ndarray]
    ) -> GammaPath:
        """Solve at the Chebyshev-Lobatto levels from 0 to gamma_f.

        The interpolation error of the path is the response to the interpolation error of the weights. So the number of
        nodes is increased, before anything is solved, until that is below `PATH_ERROR`. The weights |K|^gamma are
        entire functions of gamma, hence the error falls faster than geometrically.
        """
        if not (gamma_f != 0 and np.isfinite(gamma_f)):
            raise SettingsError(f"gamma={gamma_f:g}: a path needs a level other than 0")
        count, error = self.settings.path_nodes, None
        if count == 0:
            extent = diagonal(self.vertices)
            for count in range(2, MAX_TRIED_NODES + 1):
                error = self._interpolation_error(lobatto_levels(count, gamma_f), weights, response) / extent
                if error <= PATH_ERROR:
                    break
        levels = lobatto_levels(count, gamma_f)
        displacements = np.stack([solve(float(level)) for level in levels]).astype(np.float32)
        report = {
            "source": "poisson",
            "settings": json.loads(json.dumps(asdict(self.settings))),
            **self.report,
            "nodes": count,
            "path_error": error,
            "largest_displacement": float(np.abs(displacements[-1]).max()),
        }
        return GammaPath(levels, displacements, self.faces, self.vertices, report)

    def _interpolation_error(self, levels: Float[np.ndarray, " k"], weights: LevelWeights, response: Response) -> float:
        """Largest displacement between interpolation and solution, midway between the two nodes where it is worst."""
        node_weights, nodes = np.stack([weights(level) for level in levels]), barycentric_weights(levels)
        midpoints = (levels[1:] + levels[:-1]) / 2
        errors = [np.array(lagrange_weights(nodes, level)) @ node_weights - weights(level) for level in midpoints]
        worst = max(errors, key=lambda error: self.face_areas @ error**2)
        return float(np.linalg.norm(response(worst), axis=1).max())
