"""Solvers of symmetric positive definite systems: sparse factorisation, conjugate gradients, the Poisson equation.

Factorisation uses cholespy's Cholesky solver if it is installed (the extra `fast`), otherwise SciPy's SuperLU.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu
from threadpoolctl import ThreadpoolController

COLUMNS = 16
"""Number of right-hand sides that SuperLU solves at once."""
_BLAS = ThreadpoolController().select(user_api="blas")
"""Limited to one thread during a solve: its matrix products are too small for several."""

MINIMUM_DEGREE = 30_000
"""Number of rows up to which SuperLU orders by minimum degree on A^T + A.

For heads this leaves 28 to 42 % fewer entries in the factors than COLAMD, SuperLU's default. At 80 000 rows both cost
the same, and at 320 000 the ordering takes minutes.
"""
SYMMETRIC = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}

try:
    from cholespy import CholeskySolverD, MatrixType
except ImportError:  # the extra `fast`
    CholeskySolverD = None


class CholeskySolver:
    """A factorised symmetric positive definite matrix."""

    def __init__(self, matrix: csc_array) -> None:
        """Factorise.

        Args:
            matrix: Symmetric positive definite matrix (n, n).
        """
        if CholeskySolverD is None:
            self._lu = splu(matrix.tocsc(), **(SYMMETRIC if matrix.shape[0] <= MINIMUM_DEGREE else {}))
        else:
            entries = matrix.tocoo()
            rows, columns = entries.row.astype(np.int32), entries.col.astype(np.int32)
            self._cholesky = CholeskySolverD(
                matrix.shape[0], rows, columns, entries.data.astype(np.float64), MatrixType.COO
            )

    def solve(self, right: Float[np.ndarray, "n c"]) -> Float[np.ndarray, "n c"]:
        """Solve for all columns of a right-hand side.

        Args:
            right: Right-hand sides.

        Returns:
            Solutions, column by column.
        """
        if CholeskySolverD is None:
            return solve_in_blocks(self._lu, right)
        solution = np.zeros(right.shape)
        self._cholesky.solve(np.ascontiguousarray(right), solution)
        return solution


class PoissonSolver:
    """A factorised Poisson equation W u = b whose null space, one constant per component, is fixed by the centroids.

    W is positive semi-definite, such as the cotan stiffness. One vertex of each component is pinned, which makes the
    rest positive definite; each solution is then shifted so that the area-weighted mean of every component is 0.

    This also solves the unconstrained least squares min |L u - b'|_A^2 with L = A^-1 W and b' = A^-1 b (paper,
    equation 3): its residual is zero.
    """

    def __init__(
        self,
        matrix: csc_array,
        components: Int[np.ndarray, " v"],
        solved: Bool[np.ndarray, " v"],
        areas: Float[np.ndarray, " v"],
    ) -> None:
        """Factorise.

        Args:
            matrix: The matrix W (v, v).
            components: Label of the component of each vertex.
            solved: Vertices to solve for: whole components. The solution is 0 at the others.
            areas: Weights of the vertices in the means.
        """
        pinned = np.unique(components, return_index=True)[1]
        self._free = np.setdiff1d(np.flatnonzero(solved), pinned)
        self._factors = CholeskySolver(matrix[self._free][:, self._free].tocsc())
        members = [np.flatnonzero(components == c) for c in np.unique(components[solved])]
        self._mean_weights = [(ids, areas[ids] / areas[ids].sum()) for ids in members]

    def solve(self, right: Float[np.ndarray, "v c"]) -> Float[np.ndarray, "v c"]:
        """Solve for all columns of a right-hand side.

        Args:
            right: Right-hand sides, each of sum 0 on every component.

        Returns:
            Solutions, column by column.
        """
        solution = np.zeros_like(right)
        solution[self._free] = self._factors.solve(right[self._free])
        for ids, mean_weights in self._mean_weights:
            solution[ids] -= mean_weights @ solution[ids]
        return solution


def solve_in_blocks(lu: SuperLU, right: Float[np.ndarray, "n c"]) -> Float[np.ndarray, "n c"]:
    """Solve with SuperLU's factors, `COLUMNS` right-hand sides at a time.

    Args:
        lu: Factors of a matrix (n, n).
        right: Right-hand sides.

    Returns:
        Solutions, column by column.
    """
    with _BLAS.limit(limits=1):
        return np.concatenate([lu.solve(right[:, c : c + COLUMNS]) for c in range(0, right.shape[1], COLUMNS)], axis=1)


def conjugate_gradients(
    matrix: csc_array, right: Float[np.ndarray, " n"], start: Float[np.ndarray, " n"], most: int = 1000
) -> Float[np.ndarray, " n"] | None:
    """Conjugate gradients, preconditioned by the diagonal (Saad 2003, algorithm 9.1).

    SciPy's implementation takes its sums from BLAS, whose digits depend on the number of threads.

    Args:
        matrix: Symmetric positive definite matrix (n, n).
        right: Right-hand side.
        start: Initial guess.
        most: Maximum number of iterations.

    Returns:
        The solution to about eleven digits, or None if the iterations do not suffice.
    """
    inverse, x = 1 / matrix.diagonal(), start.copy()
    residual = right - matrix @ x
    direction = scaled = inverse * residual
    energy = (residual * scaled).sum()
    tolerance = 1e-23 * (right * inverse * right).sum()
    for _ in range(most):
        if energy <= tolerance:
            return x
        image = matrix @ direction
        step = energy / (direction * image).sum()
        x += step * direction
        residual = residual - step * image
        scaled = inverse * residual
        previous, energy = energy, (residual * scaled).sum()
        direction = scaled + energy / previous * direction
    return None
