"""Normal equations of a sequence of frames with shared shape: block tridiagonal with a border."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve, cho_solve_banded, cholesky_banded


@dataclass
class NormalEquations:
    """Gauss-Newton matrix and gradient for t frames of q parameters each and s shared shape coefficients.

    Neighbouring frames are coupled through equal parameters alone (temporal smoothness), so that the matrix of all
    frames has the half-bandwidth q.
    """

    frames: Float[np.ndarray, "t q q"]
    """Diagonal blocks."""
    links: Float[np.ndarray, "t-1 q"]
    """Entries between each parameter of a frame and the same one of the next frame."""
    border: Float[np.ndarray, "t q s"]
    shape: Float[np.ndarray, "s s"]
    frame_gradient: Float[np.ndarray, "t q"]
    shape_gradient: Float[np.ndarray, " s"]

    def solve(self, damping: float = 0.0) -> tuple[Float[np.ndarray, "t q"], Float[np.ndarray, " s"]]:
        """The step -A^-1 g, by a banded Cholesky factorisation and the Schur complement of the shape.

        Args:
            damping: Share of the diagonal that is added to it (Marquardt 1963).

        Returns:
            Steps of the frames' parameters and of the shape.

        Raises:
            numpy.linalg.LinAlgError: If the matrix is not positive definite.
        """
        t, q, s = self.border.shape
        band = np.zeros((q + 1, t, q))  # LAPACK's lower form: band[d, column] = A[column + d, column]
        row, column = np.tril_indices(q)
        band[row - column, :, column] = self.frames[:, row, column].T
        band[0] *= 1 + damping
        band[q, :-1] = self.links
        factor = cholesky_banded(band.reshape(q + 1, t * q), lower=True, overwrite_ab=True, check_finite=False)
        known = np.concatenate([self.border, self.frame_gradient[:, :, None]], axis=2).reshape(t * q, s + 1)
        solved = cho_solve_banded((factor, True), known, check_finite=False)
        shape_step = np.zeros(s)
        if s:
            damped = self.shape + damping * np.diag(np.diag(self.shape))
            complement = damped - known[:, :s].T @ solved[:, :s]
            right = known[:, :s].T @ solved[:, s] - self.shape_gradient
            shape_step = cho_solve(cho_factor(complement, lower=True), right)
        return -(solved[:, s] + solved[:, :s] @ shape_step).reshape(t, q), shape_step
