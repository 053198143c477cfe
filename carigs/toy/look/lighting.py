"""The light of the capture studio, fixed to the world: one soft key, and light from all around."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

KEY_DIRECTION = np.array([0.42, 0.50, 0.76]) / np.linalg.norm([0.42, 0.50, 0.76])
"""Towards the key light: from the front, above, to the subject's left."""
KEY_COLOUR = np.array([0.36, 0.345, 0.32])

# Irradiance over pi by the normal, as a second-order polynomial in it (Ramamoorthi and Hanrahan 2001):
# constant, x, y, z, and z^2 - 1/3.  Bright from above and in front, warm from below.
AMBIENT = np.array(
    [
        [0.62, 0.62, 0.63],
        [0.09, 0.09, 0.08],
        [0.17, 0.17, 0.18],
        [0.22, 0.22, 0.21],
        [0.08, 0.08, 0.08],
    ]
)


@dataclass(frozen=True)
class Light:
    """The studio's light, turned by `world_from_light`; linear colours."""

    world_from_light: Float[np.ndarray, "3 3"] = field(default_factory=lambda: np.eye(3))

    @property
    def key(self) -> Float[np.ndarray, "3"]:
        """Unit vector towards the key light, in world axes."""
        return self.world_from_light @ KEY_DIRECTION

    def ambient(self, normals: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Irradiance over pi from all around for unit normals in world axes."""
        local = normals @ self.world_from_light
        terms = np.concatenate([np.ones((len(local), 1)), local, local[:, 2:] ** 2 - 1 / 3], axis=1)
        return terms @ AMBIENT

    @property
    def rows(self) -> Float[np.ndarray, "7 3"]:
        """For the kernels, in world axes: key, its colour, ambient constant, three rows of slopes, the squared axis."""
        slopes = self.world_from_light @ AMBIENT[1:4]
        return np.concatenate(
            [self.key[None], KEY_COLOUR[None], AMBIENT[:1], slopes, self.world_from_light[:, 2][None]]
        )


AMBIENT_SQUARE = AMBIENT[4]
