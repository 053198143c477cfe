"""A caricature of one region: the rest of the head stays where it is.

The level fades from the region's to 0 over a smooth ramp, so that no flux is left over at the border, and what is
beyond is held.  Three ways to hold it (`Exaggerate.local`):

- `soft`: a screen that grows as the region fades: (A + s M) u = W_(w-1) x.  As cheap as the head, smooth at the border.
- `exact`: nothing beyond the ramp moves by a single bit (an eyeball only where the region holds its socket), and the
  border is still smooth: the least squares of the paper's equation 4, with the held vertices eliminated, which is a
  bi-Laplacian.
- `literal`: equation 4 as it stands: no ramp, and weights that do not end at the border, where they leave ripples.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from scipy.sparse import diags_array

from carigs.errors import SettingsError
from carigs.exaggeration.gamma_path import GammaPath
from carigs.exaggeration.solved_path import solved_path
from carigs.mesh.linear_solver import CholeskySolver

if TYPE_CHECKING:
    from carigs.exaggeration.exaggerator import Exaggerator

SCREEN = (10.0, 0.02)
"""Of a vertex that is held: stiffness, and the length over which it is felt in head sizes."""
BEYOND = 0.05
"""Head sizes beyond the ramp over which the soft mode fades to nothing: eight times the screen's decay."""


class LocalEdit:
    """One region of a head, factorised once for all levels."""

    def __init__(self, solver: Exaggerator, region: str | np.ndarray | Sequence[int]) -> None:
        """`region` as in `Regions.field`.  Raises `SettingsError` for one that leaves nothing to hold it."""
        self._solver, self._mode = solver, solver.settings.region_constraint
        self.field = solver.regions.field(region, ramp=self._mode != "literal")
        """1 in the region, 0 where nothing is exaggerated."""
        reach = BEYOND if self._mode == "soft" else 0.0
        moving = (self.field > 0) | (solver.regions.distance(self.field > 0) < reach)
        self._moving = np.flatnonzero(moving & solver.solved)
        _check_held(solver, self.field, self._moving)
        # An eyeball would follow the edge of the ramp in its socket, however little that moves.
        most = [group for group in solver.followers if self.field[group.around].mean() >= 0.5]
        self._followers = solver.followers if self._mode == "soft" else most
        rows = solver.system[:, self._moving]
        if self._mode == "soft":
            stiffness, length = SCREEN
            held = stiffness * (1 - self.field) * solver.areas / (length * solver.size) ** 2
            self._factors = CholeskySolver((rows.tocsr()[self._moving] + diags_array(held[self._moving])).tocsc())
        else:
            self._least_squares = (rows.T @ diags_array(1 / solver.areas)).tocsr()
            self._factors = CholeskySolver((self._least_squares @ rows).tocsc())

    def weights(self, level: float) -> Float[np.ndarray, " f"]:
        """W per face: |K|^level in the region, 1 beyond the ramp (in `literal` mode |K|^level everywhere)."""
        if self._mode == "literal":
            return self._solver.weights(level)
        return self._solver.face_mean(np.exp(level * self.field * self._solver.log_curvature))

    def response(self, strain: Float[np.ndarray, " f"]) -> Float[np.ndarray, "v 3"]:
        """The displacement that weights of 1 + strain cause; linear in the strain."""
        divergence = self._solver.divergence(strain)
        right = divergence[self._moving] if self._mode == "soft" else self._least_squares @ divergence
        displacement = np.zeros_like(self._solver.vertices)
        displacement[self._moving] = self._factors.solve(right)
        return displacement

    def solve(self, level: float) -> Float[np.ndarray, "v 3"]:
        """The displacement at a level, exactly zero at level 0."""
        if level == 0:
            return np.zeros_like(self._solver.vertices)
        return self._solver.with_followers(self.response(self.weights(level) - 1), self._followers)

    def path(self, gamma_f: float) -> GammaPath:
        """The region at all levels from 0 to gamma_f."""
        return solved_path(self, gamma_f, self._solver)


def _check_held(solver: Exaggerator, field: Float[np.ndarray, " v"], moving: np.ndarray) -> None:
    if not len(moving):
        raise SettingsError("a region holds no vertex that the equation moves: small components follow the others")
    held = solver.solved & (field < 1)
    if np.setdiff1d(solver.component[moving], solver.component[held]).size:
        raise SettingsError("a region covers a whole component: nothing is left to hold it; solve without a region")
