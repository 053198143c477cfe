"""The light of the capture studio, fixed to the world: one key light, and ambient light from all around."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

_KEY_DIRECTION = np.array([0.42, 0.50, 0.76]) / np.linalg.norm([0.42, 0.50, 0.76])  # front, above, subject's left
KEY_COLOUR = np.array([0.36, 0.345, 0.32])
"""Linear colour of the key light."""

# Irradiance over pi as a second-order polynomial of the normal (Ramamoorthi and Hanrahan 2001), one row per term:
# 1, x, y, z, z^2 - 1/3. Brighter from above and from the front.
_AMBIENT = np.array(
    [[0.62, 0.62, 0.63], [0.09, 0.09, 0.08], [0.17, 0.17, 0.18], [0.22, 0.22, 0.21], [0.08, 0.08, 0.08]]
)


@dataclass(frozen=True)
class StudioLight:
    """The light of the studio in linear colours, optionally rotated."""

    world_from_light: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))

    @property
    def key_direction(self) -> Float[np.ndarray, "3"]:
        """Unit vector towards the key light, in world axes."""
        return self.world_from_light @ _KEY_DIRECTION

    def ambient(self, normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Ambient irradiance over pi.

        Args:
            normals: Unit normals in world axes.

        Returns:
            Linear colours.
        """
        local = normals @ self.world_from_light
        terms = np.concatenate([np.ones((len(local), 1)), local, local[:, 2:] ** 2 - 1 / 3], axis=1)
        return terms @ _AMBIENT

    @property
    def coefficients(self) -> Float[np.ndarray, "8 3"]:
        """The light for the shading kernel, in world axes.

        Rows: 0 direction of the key light, 1 its colour; ambient light: 2 constant term, 3-5 linear terms, 6 axis and
        7 colour of the quadratic term.
        """
        slopes = self.world_from_light @ _AMBIENT[1:4]
        rows = [self.key_direction, KEY_COLOUR, _AMBIENT[0], *slopes, self.world_from_light[:, 2], _AMBIENT[4]]
        return np.stack(rows)
