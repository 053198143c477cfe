"""A choice of frames, timesteps, cameras or vertices that covers all of them evenly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np


def evenly_spread(items: Sequence, count: int) -> list:
    """Choose items at even distances, the first and the last among them.

    Args:
        items: Items in order.
        count: Most items to choose.

    Returns:
        The chosen ones, in their order; all if there are no more than `count`.
    """
    return [items[i] for i in sorted({int(i) for i in np.linspace(0, len(items) - 1, min(count, len(items)))})]
