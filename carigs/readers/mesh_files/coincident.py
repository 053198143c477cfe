"""Vertices at the same place, and polygons that a file holds twice, as for a surface that is seen from both sides."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int, Int64


def places(vertices: Float[np.ndarray, "v 3"]) -> Int64[np.ndarray, " v"]:
    """Equal numbers for vertices at exactly the same place.

    Args:
        vertices: Positions, in any unit.

    Returns:
        Numbers from 0.
    """
    return equal_rows(np.stack([np.unique(column, return_inverse=True)[1] for column in vertices.T], axis=1))


def equal_rows(rows: Int[np.ndarray, "m n"]) -> Int64[np.ndarray, " m"]:
    """Equal numbers for equal rows; faster than `np.unique` of rows.

    Args:
        rows: Whole numbers from 0.

    Returns:
        Numbers from 0.
    """
    numbers = np.zeros(len(rows), np.int64)
    for column in rows.T:
        numbers = np.unique(numbers * (int(column.max(initial=0)) + 1) + column, return_inverse=True)[1]
    return numbers


def triangles_of_twins(
    corner_places: Int[np.ndarray, "m n"], order: Int64[np.ndarray, "m t 3"]
) -> Int64[np.ndarray, "m t 3"]:
    """Cut polygons at the same place alike: from another first corner, or in reverse, a fan has other diagonals.

    Args:
        corner_places: `places` of the corners of each polygon.
        order: Corners of its triangles.

    Returns:
        The same, of a polygon that has the corners of an earlier one in the same or in the reverse order as of that.
    """
    by_place = corner_places.argsort(axis=1)
    rows = np.take_along_axis(corner_places, by_place, axis=1)
    _, earliest, group = np.unique(equal_rows(rows), return_index=True, return_inverse=True)
    twin = np.flatnonzero((earliest[group] != np.arange(len(rows))) & (rows[:, 1:] != rows[:, :-1]).all(axis=1))
    first, n = earliest[group[twin]], rows.shape[1]
    rank = by_place.argsort(axis=1)

    def neighbours(which: Int[np.ndarray, " k"], step: int) -> Int[np.ndarray, "k n"]:
        """By place, the rank of the next corner or of the one before."""
        ranks = rank[which]
        return np.take_along_axis(np.roll(ranks, -step, axis=1), by_place[which], axis=1)

    is_same = (neighbours(twin, 1) == neighbours(first, 1)).all(axis=1)
    is_reverse = (neighbours(twin, 1) == neighbours(first, -1)).all(axis=1)
    ranks = np.take_along_axis(rank[first], order[first].reshape(len(first), 3 * (n - 2)), axis=1)
    copied = np.take_along_axis(by_place[twin], ranks, axis=1).reshape(-1, n - 2, 3)
    copied[is_reverse] = copied[is_reverse][:, :, ::-1]
    result = order.copy()
    alike = is_same | is_reverse
    result[twin[alike]] = copied[alike]
    return result
