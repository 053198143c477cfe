"""Confidence intervals of means over frames that share subjects, timesteps, cameras and trainings."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.typing import ArrayLike
from scipy.special import stdtrit

MIN_LEVELS = 8
"""A factor with fewer levels is not resampled: of three, one bootstrap sample in nine holds a single one."""
CONFIDENCE, RESAMPLES, SEED = 0.95, 2000, 0
"""Confidence level of the intervals of tables, cards and reports; number of bootstrap resamples, and their seed."""
DEGENERATE = 1e-9
"""Samples whose standard error is below this share of that of the values have no t: all their values are equal."""


class Interval(NamedTuple):
    """Mean with the ends of its confidence interval, which are nan for a single value."""

    mean: float
    low: float
    high: float


def mean_interval(
    values: Float[np.ndarray, " n"],
    factors: Sequence[ArrayLike],
    *,
    resamples: int = RESAMPLES,
    confidence: float = CONFIDENCE,
    seed: int = SEED,
) -> Interval:
    """Mean of values and its confidence interval under crossed random factors.

    Frames of one camera, timestep or training are not independent. The variance of the mean has a part for each factor
    f and one for the residuals, which the analysis of variance with crossed random effects estimates:

        s_f^2 = max(A_f - R, 0)    and    R,    s^2 = sum_f s_f^2 + R,

    where A_f is the variance of the means over the levels of f divided by their number, and R the variance of the
    residuals divided by the number of cells, which each A_f contains. The interval is

    - mean - q s with the quantiles q of the bootstrap-t (Efron and Tibshirani 1993, "An introduction to the bootstrap",
      section 12.5), for which the levels of every factor are resampled independently (Owen 2007, "The pigeonhole
      bootstrap");
    - mean +- sqrt(sum_f t_f^2 s_f^2 + t_R^2 R) where a factor has fewer than `MIN_LEVELS` levels, with the quantiles t
      of Student's distribution for the degrees of freedom of each part (Banerjee 1961, "On confidence interval for
      two-means problem based on separate estimates of variances and tabulated values of t-table").

    Values of the same cell are averaged; cells without values take part with what the additive model of the others
    predicts (Yates 1933, "The analysis of replicated experiments when the field results are incomplete").

    Args:
        values: Values of a metric, one per frame.
        factors: For each factor (such as timestep, camera and seed) the label of every value.
        resamples: Number of bootstrap resamples.
        confidence: Coverage of the interval, between 0 and 1.
        seed: Seed of the resampling.

    Returns:
        Mean and interval. They do not depend on the order of the values.
    """
    levels = [np.unique(np.asarray(factor), return_inverse=True)[1] for factor in factors]
    levels = np.array(levels, int).reshape(len(factors), len(values))
    order = np.lexsort((values, *levels[::-1]))
    values, levels = values[order].astype(np.float64), levels[:, order]
    mean = float(values.mean())
    table = _cell_means(values, levels)
    if table.size < 2:
        return Interval(mean, float("nan"), float("nan"))
    missing = np.isnan(table)
    table, missing = _filled(table, missing) - mean, int(missing.sum())
    uniform = tuple(np.full((1, count), 1 / count) for count in table.shape)
    parts = _variance_parts(table, uniform, missing)[1][0]
    tail = (1 - confidence) / 2
    if min(table.shape) < MIN_LEVELS:
        freedom = [count - 1 for count in table.shape] + [max(_residual_freedom(table.shape, missing), 1)]
        half = float(np.sqrt(np.sum(stdtrit(freedom, 1 - tail) ** 2 * parts)))
        return Interval(mean, mean - half, mean + half)
    error = np.sqrt(parts.sum())
    means, drawn_parts = _variance_parts(table, _resampled_weights(table.shape, resamples, seed))
    errors = np.sqrt(drawn_parts.sum(axis=1))
    varied = errors > DEGENERATE * error
    if not varied.any():
        return Interval(mean, mean, mean) if error == 0 else Interval(mean, float("nan"), float("nan"))
    low, high = np.quantile((means - table.mean())[varied] / errors[varied], [tail, 1 - tail])
    return Interval(mean, float(mean - high * error), float(mean - low * error))


def _cell_means(values: Float[np.ndarray, " n"], levels: Int[np.ndarray, "f n"]) -> Float[np.ndarray, "..."]:
    """Mean of the values of each cell, nan without any. Factors of a single level are left out.

    Where there are too few cells to tell the factors from the residuals, those with most levels are left out as well.
    """
    counts = [int(factor.max()) + 1 for factor in levels]
    used = sorted((f for f, count in enumerate(counts) if count > 1), key=lambda f: counts[f])
    while True:
        shape = tuple(counts[f] for f in used)
        cell = np.ravel_multi_index(tuple(levels[f] for f in used), shape) if used else np.zeros(len(values), int)
        number = np.bincount(cell, minlength=int(np.prod(shape)))
        if len(used) < 2 or _residual_freedom(shape, int((number == 0).sum())) > 0:
            with np.errstate(invalid="ignore"):
                return (np.bincount(cell, values, minlength=len(number)) / number).reshape(shape)
        used.pop()


def _filled(table: Float[np.ndarray, "..."], missing: Bool[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Put the additive model's prediction into cells without values."""
    table = np.where(missing, np.mean(table[~missing]), table)
    axes = range(table.ndim)
    for _ in range(1000 if missing.any() else 0):
        marginals = [table.mean(axis=tuple(a for a in axes if a != axis), keepdims=True) for axis in axes]
        change = np.where(missing, sum(marginals) - (table.ndim - 1) * table.mean() - table, 0)
        table = table + change
        if np.abs(change).max() <= 1e-9 * np.ptp(table):
            break
    return table


def _variance_parts(
    table: Float[np.ndarray, "..."], weights: Sequence[Float[np.ndarray, "r _"]], missing: int = 0
) -> tuple[Float[np.ndarray, " r"], Float[np.ndarray, "r parts"]]:
    """Mean, and the parts of its variance by each factor and by the residuals, for every set of weights.

    Args:
        table: Value of each cell; each axis is a factor.
        weights: Weight of the levels of each factor in each resample; they sum to 1.
        missing: Number of cells without values of their own.
    """
    mean = _weighted_mean(table, weights)
    rest = _weighted_mean(table**2, weights) - mean**2
    of_factors = []
    for factor, count in enumerate(table.shape):
        marginal = _weighted_mean(table, weights, keep=factor)
        spread = np.einsum("rl,rl->r", weights[factor], (marginal - mean[:, None]) ** 2)
        rest = rest - spread
        of_factors.append(spread / (count - 1))
    freedom = _residual_freedom(table.shape, missing)
    residual = np.maximum(rest, 0) * (table.size / (freedom * (table.size - missing)) if freedom else 0)
    return mean, np.stack([*(np.maximum(part - residual, 0) for part in of_factors), residual], axis=1)


def _weighted_mean(
    table: Float[np.ndarray, "..."], weights: Sequence[Float[np.ndarray, "r _"]], keep: int | None = None
) -> Float[np.ndarray, "..."]:
    """Means over all factors (r), or over all but one (r, levels of `keep`).

    Not by BLAS, whose sums may depend on the number of threads.
    """
    axes = list(range(1, table.ndim + 1))
    for axis in axes[::-1]:
        if axis - 1 != keep:
            rest = [0, *(a for a in axes if a not in (0, axis))]
            table, axes = np.einsum(table, axes, weights[axis - 1], [0, axis], rest), rest
    return table


def _residual_freedom(shape: Sequence[int], missing: int) -> int:
    """Degrees of freedom of the residuals of the additive model."""
    return int(np.prod(shape)) - missing - 1 - sum(count - 1 for count in shape)


@lru_cache(maxsize=16)  # all metrics and regions of the same frames have the same weights
def _resampled_weights(shape: tuple[int, ...], resamples: int, seed: int) -> tuple[Float[np.ndarray, "r _"], ...]:
    """Share of each level of each factor in the bootstrap samples."""
    generator = np.random.default_rng(seed)
    return tuple(generator.multinomial(count, np.full(count, 1 / count), size=resamples) / count for count in shape)
