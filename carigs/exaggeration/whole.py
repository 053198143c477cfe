"""The whole head on its way to a level, each region at a pace of its own."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from carigs.errors import SettingsError
from carigs.mesh.regions import partition_of_unity

if TYPE_CHECKING:
    from carigs.exaggeration.exaggerator import Exaggerator


class Whole:
    """A head as `solved_path` interpolates it: its weights and solutions at every level."""

    def __init__(self, solver: Exaggerator, level: float, levels: Mapping[str, float] | None) -> None:
        """Regions have `levels` of their own where the rest has `level`; raises `SettingsError` for no numbers."""
        self._solver, self.response, self._pace = solver, solver.response, 1.0
        if levels:
            if not np.isfinite(list(levels.values())).all():
                raise SettingsError(f"levels of regions must be numbers, found {dict(levels)}")
            if level == 0:
                raise SettingsError("levels of regions on a head at level 0: use `region_paths`, which hold the rest")
            shares = partition_of_unity(np.stack([solver.regions.field(name) for name in levels]))
            self._pace = 1 + (np.array(list(levels.values())) / level - 1) @ shares

    def weights(self, level: float) -> Float[np.ndarray, " f"]:
        """W per face."""
        return self._solver.weights(level, self._pace)

    def solve(self, level: float) -> Float[np.ndarray, "v 3"]:
        """The displacement at a level, exactly zero at level 0."""
        if level == 0:
            return np.zeros_like(self._solver.vertices)
        return self._solver.with_followers(self.response(self.weights(level) - 1))
