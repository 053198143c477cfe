"""Exaggeration of one region while the rest of the head is held."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float
from scipy.sparse import diags_array

from carigs.errors import SettingsError
from carigs.exaggeration.weighted_poisson import WeightedPoisson
from carigs.mesh.linear_solver import CholeskySolver
from carigs.mesh.regions import region_label

SCREEN_STIFFNESS = 10.0
"""Stiffness that holds a vertex outside the region, in the mode `soft`."""
SCREEN_LENGTH = 0.02
"""Length over which a held vertex is felt, in head sizes, in the mode `soft`."""
SOFT_MARGIN = 0.05
"""Distance beyond the ramp over which the mode `soft` fades to nothing, in head sizes: eight times its decay."""


class LocalEdit:
    """The exaggeration of one region, factorised once for all levels.

    The level falls from the region's to 0 over a smooth ramp, so that no flux is left at the border. The setting
    `region_constraint` selects how the vertices beyond the ramp are held:

    - `soft`: screened Poisson equation (H + s A) u = W_(w - 1) x with the system matrix H, the vertex areas A, and a
      stiffness s that grows as the region fades. As cheap as the whole head, and smooth at the border.
    - `exact`: the vertices beyond the ramp do not move at all: constrained least squares with the held vertices
      eliminated, a bi-Laplacian equation. Small components move only if the region holds what surrounds them.
    - `literal`: the same without the ramp, as in the paper: the weights do not end at the border.

    `exact` and `literal` solve the paper's equation 4,

        min |L x~ - b|_A^2    subject to    B x~ = x*,    L = A^-1 W,

    where B selects the held vertices and x* are their positions in S.
    """

    def __init__(self, equation: WeightedPoisson, region: str | np.ndarray | Sequence[int]) -> None:
        """Factorise.

        Args:
            equation: The equation of the whole head.
            region: A name, vertex indices, a mask or a painted scalar, as `Regions.field` takes it.

        Raises:
            SettingsError: If the region is not valid, or leaves no vertex of a component to hold it.
        """
        self._equation, self._mode = equation, equation.settings.region_constraint
        self.field = equation.regions.field(region, ramp=self._mode != "literal")
        """1 in the region, 0 where nothing is exaggerated."""
        margin = SOFT_MARGIN if self._mode == "soft" else 0.0
        is_free = (self.field > 0) | (equation.regions.distance(self.field > 0) < margin)
        self._free = np.flatnonzero(is_free & equation.solved_vertices)
        self._check_held(region_label(region))
        self._rigid_components = equation.rigid_components
        if self._mode != "soft":  # an eyeball would follow the edge of the ramp in its socket, however little it moves
            self._rigid_components = [c for c in self._rigid_components if self.field[c.surrounding].mean() >= 0.5]
        columns = equation.system[:, self._free]
        if self._mode == "soft":
            screen = SCREEN_STIFFNESS * (1 - self.field) * equation.areas / (SCREEN_LENGTH * equation.size) ** 2
            self._factors = CholeskySolver((columns.tocsr()[self._free] + diags_array(screen[self._free])).tocsc())
        else:
            self._least_squares = (columns.T @ diags_array(1 / equation.areas)).tocsr()
            self._factors = CholeskySolver((self._least_squares @ columns).tocsc())

    def weights(self, level: float) -> Float[np.ndarray, " f"]:
        """Weights of the faces: |K|^gamma in the region, 1 beyond the ramp.

        Args:
            level: Exaggeration gamma of the region.

        Returns:
            Weight of each face; in the mode `literal` |K|^gamma everywhere.
        """
        if self._mode == "literal":
            return self._equation.weights(level)
        return self._equation.curvature_power(level * self.field)

    def response(self, delta_weights: Float[np.ndarray, " f"]) -> Float[np.ndarray, "v 3"]:
        """Solve the constrained equation for a change of the weights; linear in it.

        Args:
            delta_weights: w - 1 of each face.

        Returns:
            Displacement of the solved vertices, in the unit of the mesh.
        """
        divergence = self._equation.weighted_divergence(delta_weights)
        right = divergence[self._free] if self._mode == "soft" else self._least_squares @ divergence
        displacement = np.zeros_like(self._equation.vertices)
        displacement[self._free] = self._factors.solve(right)
        return displacement

    def solve(self, level: float) -> Float[np.ndarray, "v 3"]:
        """Solve for the displacement at a level of the region.

        Args:
            level: Exaggeration gamma of the region.

        Returns:
            Displacement of all vertices, in the unit of the mesh; exactly 0 at level 0.
        """
        if level == 0:
            return np.zeros_like(self._equation.vertices)
        return self._equation.move_rigid_components(self.response(self.weights(level) - 1), self._rigid_components)

    def _check_held(self, label: str) -> None:
        """Raise `SettingsError` if nothing moves, or a component is not held anywhere."""
        if not len(self._free):
            raise SettingsError(f"{label} holds only small components, which follow the skin: add vertices of the skin")
        held, labels = self._equation.solved_vertices & (self.field < 1), self._equation.component_labels
        if np.setdiff1d(labels[self._free], labels[held]).size:
            raise SettingsError(f"{label} covers a whole component: leave out some vertices, or solve without regions")
