"""Systems whose null space is a constant on each component, fixed by the components' centroids."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csc_array

from carigs.mesh.linear_solver import CholeskySolver


class PinnedSystem:
    """A u = b with A positive semi-definite, factorised once: the solution that moves no component's centroid.

    (Paper, equations 2 and 3: the unconstrained least squares has no residual, so that this is its solution.)
    """

    def __init__(
        self,
        matrix: csc_array,
        component: Int[np.ndarray, " v"],
        solved: Bool[np.ndarray, " v"],
        areas: Float[np.ndarray, " v"],
    ) -> None:
        """`solved` are whole components, the others get 0; centroids are weighted by the vertices' `areas`."""
        # One vertex of each component is pinned; the others' system is symmetric positive definite.
        pinned = np.unique(component, return_index=True)[1]
        self._free = np.setdiff1d(np.flatnonzero(solved), pinned)
        self._factors = CholeskySolver(matrix[self._free][:, self._free].tocsc())
        inside = [np.flatnonzero(component == c) for c in np.unique(component[solved])]
        self._centroids = [(ids, areas[ids] / areas[ids].sum()) for ids in inside]

    def solve(self, right: Float[np.ndarray, "v c"]) -> Float[np.ndarray, "v c"]:
        """The solutions for all columns."""
        solution = np.zeros_like(right)
        solution[self._free] = self._factors.solve(right[self._free])
        for inside, shares in self._centroids:
            solution[inside] -= shares @ solution[inside]
        return solution
