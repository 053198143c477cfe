"""Percentile bootstrap intervals of means over frames that share timesteps and cameras."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Interval(NamedTuple):
    """Mean with the ends of its confidence interval, which are nan for a single value."""

    mean: float
    low: float
    high: float


def mean_interval(
    values: Float[np.ndarray, " n"],
    units: Sequence[Sequence[Hashable]],
    *,
    resamples: int,
    confidence: float,
    seed: int,
) -> Interval:
    """Mean of values and its percentile bootstrap interval under crossed random factors.

    The levels of every factor are resampled independently; a value counts as often as the product of its levels' counts
    (pigeonhole bootstrap, Owen 2007, "The pigeonhole bootstrap"). Frames of one camera or timestep are not independent:
    resampling frames one by one gives intervals that are too narrow.

    Args:
        values: Values of a metric, one per frame.
        units: For each factor (subject, timestep, camera) the label of every value.
        resamples: Number of bootstrap resamples.
        confidence: Coverage of the interval, between 0 and 1.
        seed: Seed of the resampling.

    Returns:
        Mean and interval. They do not depend on the order of the values.
    """
    levels = np.array([_ranks(factor) for factor in units], int).reshape(len(units), len(values))
    order = sorted(range(len(values)), key=lambda i: (*levels[:, i], values[i]))
    sorted_values = values[order].astype(np.float64)
    mean = float(sorted_values.mean())
    if len(sorted_values) < 2:
        return Interval(mean, float("nan"), float("nan"))
    sorted_levels = levels[:, order]
    weights = _resampled_weights(sorted_levels.tobytes(), sorted_levels.shape, resamples, seed)
    total = weights.sum(axis=1)
    drawn = total > 0  # with missing cells, a resample may be empty
    # Not by BLAS, whose sums may depend on the number of threads.
    means = np.einsum("rn,n->r", weights[drawn], sorted_values) / total[drawn]
    tail = 50 * (1 - confidence)
    low, high = np.percentile(means, [tail, 100 - tail])
    return Interval(mean, float(low), float(high))


@lru_cache(maxsize=16)  # all metrics and regions of the same frames have the same weights
def _resampled_weights(
    levels: bytes, shape: tuple[int, int], resamples: int, seed: int
) -> Float[np.ndarray, "resamples n"]:
    """How often each value counts in each resample; `levels` is an integer array (factors, n)."""
    generator = np.random.default_rng(seed)
    weights = np.ones((resamples, shape[1]))
    for factor in np.frombuffer(levels, int).reshape(shape):
        n = int(factor.max()) + 1
        weights *= generator.multinomial(n, np.full(n, 1 / n), size=resamples)[:, factor]
    return weights


def _ranks(labels: Sequence[Hashable]) -> list[int]:
    rank = {label: i for i, label in enumerate(sorted(set(labels)))}
    return [rank[label] for label in labels]
