"""Percentile bootstrap intervals of means over frames that share timesteps and cameras."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Float


class Interval(NamedTuple):
    """A mean with its interval; the ends are nan where a single frame says nothing about spread."""

    mean: float
    low: float
    high: float


def mean_interval(
    values: Float[np.ndarray, "n"],
    units: Sequence[Sequence[Hashable]],
    *,
    resamples: int,
    confidence: float,
    seed: int,
) -> Interval:
    """Mean of `values` and its percentile bootstrap interval.

    Each of `units` labels all values by one factor, such as the timestep, or the camera.  The levels of every factor
    are resampled independently and a value counts as often as the product of its levels does (the pigeonhole bootstrap,
    Owen 2007): frames of one camera or timestep are not independent, and treating them so makes intervals too narrow.
    The result depends on `seed` and on the labelled values, but not on their order.
    """
    levels = np.array([_ranks(factor) for factor in units], int).reshape(len(units), len(values))
    order = sorted(range(len(values)), key=lambda i: (*levels[:, i], values[i]))
    sorted_values = values[order].astype(np.float64)
    mean = float(sorted_values.mean())
    if len(sorted_values) < 2:
        return Interval(mean, float("nan"), float("nan"))
    generator = np.random.default_rng(seed)
    weights = np.ones((resamples, len(sorted_values)))
    for factor in levels[:, order]:
        n = int(factor.max()) + 1
        weights *= generator.multinomial(n, np.full(n, 1 / n), size=resamples)[:, factor]
    total = weights.sum(axis=1)
    drawn = total > 0  # where cells are missing, a resample may hold none
    # Not BLAS: its sums may depend on the number of threads.
    means = np.einsum("rn,n->r", weights[drawn], sorted_values) / total[drawn]
    tail = 50 * (1 - confidence)
    low, high = np.percentile(means, [tail, 100 - tail])
    return Interval(mean, float(low), float(high))


def _ranks(labels: Sequence[Hashable]) -> list[int]:
    rank = {label: i for i, label in enumerate(sorted(set(labels)))}
    return [rank[label] for label in labels]
