"""Independent sliders of the regions of a head."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32

from carigs.errors import SettingsError
from carigs.exaggeration.gamma_path import GammaPath


@dataclass(frozen=True)
class RegionPaths:
    """A path for each region of a head with the rest held: independent sliders whose displacements add up."""

    paths: Mapping[str, GammaPath]

    def displacement(self, levels: Mapping[str, float]) -> Float32[np.ndarray, "v 3"]:
        """Displacement of the neutral with regions at their levels.

        Args:
            levels: Level of each region by name; the others stay.

        Returns:
            Displacement in metres.

        Raises:
            SettingsError: If there is no path for a name.
        """
        for name in levels:
            if name not in self.paths:
                raise SettingsError(f"no slider {name}; known: {', '.join(sorted(self.paths))}")
        zero = np.zeros_like(next(iter(self.paths.values())).displacements[0])
        return sum((self.paths[name].displacement(level) for name, level in levels.items()), start=zero)
