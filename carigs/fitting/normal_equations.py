"""Normal equations of a sequence of frames with shared shape: block tridiagonal with a border."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.lapack import dtrtrs


@dataclass
class NormalEquations:
    """Gauss-Newton matrix and gradient for t frames of q parameters each and s shared shape coefficients.

    Neighbouring frames are coupled through equal parameters alone (temporal smoothness).
    """

    frames: Float[np.ndarray, "t q q"]
    """Diagonal blocks."""
    links: Float[np.ndarray, "t-1 q"]
    """Entries between each parameter of a frame and the same one of the next frame."""
    border: Float[np.ndarray, "t q s"]
    shape: Float[np.ndarray, "s s"]
    frame_gradient: Float[np.ndarray, "t q"]
    shape_gradient: Float[np.ndarray, " s"]

    def hold(self, held: Bool[np.ndarray, "t q"]) -> None:
        """Take parameters of frames out of the equations: their step is 0.

        Args:
            held: Which.
        """
        free = ~held
        self.frames *= (free[:, :, None] & free[:, None, :]).astype(np.float64)
        np.einsum("tqq->tq", self.frames)[held] = 1
        self.links = self.links * (free[:-1] & free[1:])
        self.border *= free[:, :, None]
        self.frame_gradient[held] = 0

    def solve(self, damping: float = 0.0) -> tuple[Float[np.ndarray, "t q"], Float[np.ndarray, " s"]]:
        """The step -A^-1 g, by a block tridiagonal Cholesky factorisation and the Schur complement of the shape.

        Args:
            damping: Share of the diagonal that is added to it (Marquardt 1963).

        Returns:
            Steps of the frames' parameters and of the shape.

        Raises:
            numpy.linalg.LinAlgError: If the matrix is not positive definite.
        """
        t, q, s = self.border.shape
        factors, coupled, half = self._eliminate_frames(damping)
        shape_step = np.zeros(s)
        if s:
            complement = self.shape + damping * np.diag(np.diag(self.shape)) - half[:, :s].T @ half[:, :s]
            right = half[:, :s].T @ half[:, s] - self.shape_gradient
            shape_step = cho_solve(cho_factor(complement, lower=True), right)
        right = -(half[:, s] + half[:, :s] @ shape_step).reshape(t, q)
        step = np.empty((t, q))
        for i in reversed(range(t)):
            behind = coupled[i] @ step[i + 1] if i < t - 1 else 0
            step[i] = _solve_lower(factors[i], right[i] - behind, transposed=True)
        return step, shape_step

    def predicted_fall(self, frames: Float[np.ndarray, "t q"], shape: Float[np.ndarray, " s"], damping: float) -> float:
        """By how much a step of `solve` reduces the quadratic cost of these equations.

        Args:
            frames: Steps of the frames' parameters.
            shape: Steps of the shape.
            damping: That the step was computed with.

        Returns:
            `(damping x' D x - g' x) / 2` for the step x, the gradient g and the matrix's diagonal D.
        """
        parts = (
            (np.einsum("tqq->tq", self.frames), self.frame_gradient, frames),
            (np.diagonal(self.shape), self.shape_gradient, shape),
        )
        return 0.5 * sum(float((step * (damping * diagonal * step - slope)).sum()) for diagonal, slope, step in parts)

    def _eliminate_frames(self, damping: float) -> tuple[list[np.ndarray], list[np.ndarray], Float[np.ndarray, "r c"]]:
        """Factorise the frames' part of the matrix, A = L L^T.

        Returns L's blocks on the diagonal, those below it transposed, and L^-1 times the border and the gradient.
        """
        t, q, s = self.border.shape
        known = np.concatenate([self.border, self.frame_gradient[:, :, None]], axis=2)
        diagonal = self.frames.copy()
        np.einsum("tqq->tq", diagonal)[...] *= 1 + damping
        factors, coupled = [], []
        for i in range(t):
            if i:
                diagonal[i] -= coupled[-1].T @ coupled[-1]
                known[i] -= coupled[-1].T @ known[i - 1]
            factors.append(np.linalg.cholesky(diagonal[i]))
            known[i] = _solve_lower(factors[i], known[i])
            if i < t - 1:
                coupled.append(_solve_lower(factors[i], np.diag(self.links[i])))
        return factors, coupled, known.reshape(t * q, s + 1)


def _solve_lower(
    factor: Float[np.ndarray, "q q"], right: Float[np.ndarray, " q *columns"], *, transposed: bool = False
) -> Float[np.ndarray, " q *columns"]:
    """Solve with a lower triangular matrix, or its transpose, without the checks of `scipy.linalg.solve_triangular`."""
    solution, _ = dtrtrs(factor.T, right, lower=False, trans=not transposed)  # the transpose: as LAPACK stores matrices
    return solution
