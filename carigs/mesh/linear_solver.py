"""Symmetric positive definite systems: factorised once for many right-hand sides, or iterated for one.

The factors are cholespy's Cholesky where that is installed (the extra `fast`), else SciPy's LU.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from scipy.sparse import csc_array
from scipy.sparse.linalg import SuperLU, splu
from threadpoolctl import ThreadpoolController

COLUMNS = 16
"""SuperLU solves for so many right-hand sides at once."""
_BLAS = ThreadpoolController().select(user_api="blas")
"""Held to one thread meanwhile: on the small products of a solve, threads wait longer than they work."""

MINIMUM_DEGREE = 30_000
"""Rows up to which unknowns are eliminated in the order of the symmetric minimum degree: its factors of heads hold 28
to 42 % less than those of COLAMD, SuperLU's own.  At 80 000 both cost the same, and at 320 000 SciPy's search for that
order takes minutes."""
SYMMETRIC = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}

try:
    from cholespy import CholeskySolverD, MatrixType
except ImportError:  # the extra `fast`
    CholeskySolverD = None


class CholeskySolver:
    """The factors of a matrix (n, n); `solve` may be called as often as one likes."""

    def __init__(self, matrix: csc_array) -> None:
        if CholeskySolverD is None:
            self._lu = splu(matrix.tocsc(), **(SYMMETRIC if matrix.shape[0] <= MINIMUM_DEGREE else {}))
        else:
            self._cholesky = CholeskySolverD(matrix.shape[0], *_coordinates(matrix), MatrixType.COO)

    def solve(self, right: Float[np.ndarray, "n c"]) -> Float[np.ndarray, "n c"]:
        """The solutions for all columns of `right`."""
        if CholeskySolverD is None:
            return solve_in_blocks(self._lu, right)
        solved = np.zeros(right.shape)
        self._cholesky.solve(np.ascontiguousarray(right), solved)
        return solved


def solve_in_blocks(lu: SuperLU, right: Float[np.ndarray, "n c"]) -> Float[np.ndarray, "n c"]:
    """The solutions for all columns of `right`, by SuperLU's factors."""
    with _BLAS.limit(limits=1):
        return np.concatenate([lu.solve(right[:, c : c + COLUMNS]) for c in range(0, right.shape[1], COLUMNS)], axis=1)


def conjugate_gradients(
    matrix: csc_array, right: Float[np.ndarray, " n"], start: Float[np.ndarray, " n"], most: int = 1000
) -> Float[np.ndarray, " n"] | None:
    """The solution to about eleven digits, preconditioned by the diagonal; None if it takes more than `most` steps.

    SciPy's takes its sums from BLAS, whose digits depend on the number of threads, and which crawls on busy cores.
    """
    inverse, x = 1 / matrix.diagonal(), start.copy()
    residual = right - matrix @ x
    direction = scaled = inverse * residual
    energy = (residual * scaled).sum()
    enough = 1e-23 * (right * inverse * right).sum()
    for _ in range(most):
        if energy <= enough:
            return x
        image = matrix @ direction
        step = energy / (direction * image).sum()
        x += step * direction
        residual = residual - step * image
        scaled = inverse * residual
        previous, energy = energy, (residual * scaled).sum()
        direction = scaled + energy / previous * direction
    return None


def _coordinates(matrix: csc_array) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    entries = matrix.tocoo()
    return entries.row.astype(np.int32), entries.col.astype(np.int32), entries.data.astype(np.float64)
