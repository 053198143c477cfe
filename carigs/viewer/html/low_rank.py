"""Rows of numbers as sums of a few rows of whole numbers: truncated singular value decomposition (Eckart and Young)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float64, Int64
from threadpoolctl import threadpool_limits


class LowRank(NamedTuple):
    """An approximation of a matrix: `coefficients @ basis`."""

    coefficients: Float64[np.ndarray, "n r"]
    basis: Int64[np.ndarray, "r m"]
    """Whole numbers."""


def low_rank(rows: Float[np.ndarray, "n m"], tolerance: float, step: float) -> LowRank:
    """Approximate rows by sums of as few rows as a tolerance allows.

    Each row of the basis is rounded so that its largest coefficient times the rounding is at most half a step.

    Args:
        rows: The rows, fewer than columns.
        tolerance: Largest root mean square error of the sums before they are rounded.
        step: Twice the largest error that the rounding of one row of the basis causes; larger where whole numbers of 31
            bits could not hold the rows.

    Returns:
        The approximation. On one machine it does not depend on the number of threads.
    """
    rows = np.asarray(rows, np.float64)
    step = max(step, float(np.abs(rows).max(initial=0)) * len(rows) ** 0.5 / 2**30)
    with threadpool_limits(1):
        energy, left = np.linalg.eigh(rows @ rows.T)
        energy, left = np.maximum(energy[::-1], 0), left[:, ::-1]
        tail = energy.sum() - np.concatenate([[0], np.cumsum(energy)])
        count = int(np.argmax(tail <= tolerance**2 * rows.size + 1e-15 * energy.sum()))
        left = left[:, :count]
        basis = left.T @ rows  # not of unit length
    largest = np.abs(left).max(axis=0, initial=0)
    return LowRank(
        left * (step / np.maximum(largest, 1e-30)), np.rint(basis * largest[:, None] / step).astype(np.int64)
    )
