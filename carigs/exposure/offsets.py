"""Robust offsets of cameras, or of moments, from what they show at the same places.

The model is additive in logarithms: value of unit u at place p = offset u + sum of coefficients x covariates + level of
p. Units are cameras or timesteps, places are vertices of the head at a timestep. The levels are eliminated, so that
the normal equations have one row per unit. Places under hair and in highlights are outliers: weights are Tukey's
(Beaton and Tukey 1974), with a scale for each vertex.

Errors are those of a jackknife over patches of the head (Tukey 1958). What is wrong at one vertex, as a highlight that
only some cameras see, is wrong in its neighbours, too: vertices are not independent, patches nearly are.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float64, Int
from scipy.stats import t as student
from threadpoolctl import threadpool_limits

from carigs.exposure.known_median import median_of_known

ROUNDS = 12
"""Of least squares, then weights."""
TUKEY = 3.0
"""Residual over the scale of its vertex from which it has no weight."""
LEAST_SCALE = 0.01
"""Added to the scale of each vertex, so that none gets all the weight: the noise of an image of 8 bits."""
RIDGE = 1e-7
"""Tikhonov weight over the mean of the diagonal: units that share no place with the others stay at 0."""
LEAST_PATCHES = 4
"""Patches that must show a unit."""
SIGNIFICANCE = 0.01
"""Probability that any of the offsets that are tested together is believed to differ from 0 while none does."""


class Offsets(NamedTuple):
    """Offsets of u units in k channels."""

    offset: Float64[np.ndarray, "u k"]
    error: Float64[np.ndarray, "u k"]
    """Standard error; infinite where fewer than `LEAST_PATCHES` show the unit."""
    freedom: Float64[np.ndarray, " u"]
    """Degrees of freedom of the error."""
    residual: Float64[np.ndarray, "u t v k"]
    """What offsets, covariates and levels leave; NaN where nothing was observed or the weight is 0."""

    def is_significant(self) -> np.ndarray:
        """Test all offsets at once against 0.

        Returns:
            Whether each of the (u, k) offsets differs from 0 by Student's test with Bonferroni's correction.
        """
        tests = max(int(np.isfinite(self.error).sum()), 1)
        limit = student.isf(SIGNIFICANCE / (2 * tests), self.freedom)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.abs(self.offset) > limit * self.error


def fit_offsets(
    values: Float64[np.ndarray, "u t v k"],
    patches: Int[np.ndarray, " v"],
    reference: int | None = None,
    covariates: Float64[np.ndarray, "u t v b"] | None = None,
) -> Offsets:
    """Fit the offsets of units, and their errors.

    Args:
        values: Logarithms of what unit u shows at vertex v at time t; NaN where it shows nothing.
        patches: Patch of the head that each vertex is in.
        reference: The unit with the offset 0; None for the median of all units.
        covariates: Other causes, whose coefficients are fitted for each channel.

    Returns:
        The offsets.
    """
    known = np.isfinite(values).all(axis=-1)
    known &= known.sum(axis=0) >= 2  # a place that one unit shows says nothing
    y = np.where(known[..., None], values, 0.0)
    x = np.zeros((*known.shape, 0)) if covariates is None else covariates
    weight = known.astype(np.float64)
    with threadpool_limits(1, "blas"):  # the order of additions would depend on the number of BLAS threads
        for _ in range(ROUNDS):
            solution = _solve(*_normal_equations(y, x, weight))
            residual = np.where(known[..., None], _residual(y, x, weight, solution), np.nan)
            weight = _tukey_weights(residual)
        numbers = np.unique(patches)
        parts = [_normal_equations(*(a[:, :, patches == p] for a in (y, x, weight))) for p in numbers]
        matrix, right = (sum(part[i] for part in parts) for i in range(2))
        offset = _referred(_solve(matrix, right), len(y), reference)
        without = [_referred(_solve(matrix - m, right - r), len(y), reference) for m, r in parts]
    shown = np.array([(weight[:, :, patches == p] > 0).any(axis=(1, 2)) for p in numbers]).sum(axis=0)
    count = len(numbers)
    error = np.sqrt((count - 1) / count * ((without - np.mean(without, axis=0)) ** 2).sum(axis=0))
    error[shown < LEAST_PATCHES] = np.inf
    residual[weight == 0] = np.nan
    return Offsets(offset, error, np.maximum(shown - 1.0, 1.0), residual)


def _normal_equations(y: np.ndarray, x: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Matrix and right side for offsets and coefficients, without the levels of the places."""
    units, size = len(y), len(y) + x.shape[-1]
    total = np.maximum(weight.sum(axis=0), 1e-12)
    y_rest = y - np.einsum("utv,utvk->tvk", weight, y) / total[..., None]
    x_rest = x - np.einsum("utv,utvb->tvb", weight, x) / total[..., None]
    share = (weight / np.sqrt(total)).reshape(units, -1)
    weighted = weight[..., None] * x_rest
    matrix = np.zeros((size, size))
    matrix[:units, :units] = np.diag(weight.sum(axis=(1, 2))) - share @ share.T
    matrix[:units, units:] = weighted.sum(axis=(1, 2))
    matrix[units:, :units] = matrix[:units, units:].T
    flat, rows = weighted.reshape(weight.size, size - units), y_rest.reshape(weight.size, -1)
    matrix[units:, units:] = flat.T @ x_rest.reshape(flat.shape)
    below = flat.T @ rows
    return matrix, np.concatenate([np.einsum("utv,utvk->uk", weight, y_rest), below])


def _solve(matrix: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Offsets, then coefficients."""
    ridge = RIDGE * max(np.trace(matrix) / len(matrix), 1e-12)
    return np.linalg.solve(matrix + ridge * np.eye(len(matrix)), right)


def _residual(y: np.ndarray, x: np.ndarray, weight: np.ndarray, solution: np.ndarray) -> np.ndarray:
    rest = y - solution[: len(y), None, None] - x @ solution[len(y) :]
    total = np.maximum(weight.sum(axis=0), 1e-12)
    return rest - np.einsum("utv,utvk->tvk", weight, rest) / total[..., None]


def _tukey_weights(residual: Float64[np.ndarray, "u t v k"]) -> Float64[np.ndarray, "u t v"]:
    """Weights of Tukey over the squared scale of the vertex: the median of its residuals."""
    size = np.abs(residual).mean(axis=-1)
    scale = 1.5 * np.nan_to_num(median_of_known(size.reshape(-1, size.shape[2])), nan=1.0) + LEAST_SCALE
    ratio = np.nan_to_num(size / (TUKEY * scale), nan=np.inf)
    return np.where(ratio < 1, (1 - np.minimum(ratio, 1) ** 2) ** 2, 0.0) / scale**2


def _referred(solution: np.ndarray, units: int, reference: int | None) -> np.ndarray:
    offset = solution[:units]
    return offset - (np.median(offset, axis=0) if reference is None else offset[reference])
