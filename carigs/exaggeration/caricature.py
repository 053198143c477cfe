"""A head at one level of its caricature."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int


@dataclass(frozen=True)
class Caricature:
    """What a level adds to a head: to its neutral, and to the motions of its expressions and pose correctives."""

    displacement: Float[np.ndarray, "v 3"]
    """Of the neutral, in metres."""
    columns: Int[np.ndarray, " b"] | None = None
    """The codes whose motions change: expressions are counted first, then pose correctives.  None: no motion does."""
    changes: Float[np.ndarray, "b v 3"] | None = None
    """What is added to the motion of each of these, in metres per unit of its code."""

    def change(self, codes: Float[np.ndarray, " c"], first: int = 0) -> Float[np.ndarray, "v 3"]:
        """What is added to a motion by these codes; the count of the codes before them is `first`."""
        if self.columns is None:
            return np.zeros_like(self.displacement)
        column = self.columns - first
        here = np.flatnonzero((column >= 0) & (column < len(codes)))
        here = here[codes[column[here]] != 0]
        return np.tensordot(codes[column[here]], self.changes[here], axes=1)
