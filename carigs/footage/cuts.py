"""Cuts, repeated frames and frozen stretches, by the measures of the frames."""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.footage.measures import FrameMeasures

CUT = 0.05
"""Least change of the layout at a cut: 1 - correlation of small images. A head that turns fast stays below."""
CUT_RATIO = 5.0
"""How many times a cut changes the layout as much as the frames around it."""
NEIGHBOURS = 6
"""Frames to either side of a cut that it is compared with."""
SAME, SAME_SHARE = 0.3, 0.2
"""A repeated frame differs from the one before by less than this: levels of 8 bits, and share of the usual change."""
FROZEN_SECONDS = 0.4
"""Length from which repeated frames are called frozen."""


def find_cuts(measures: FrameMeasures) -> Int[np.ndarray, " k"]:
    """Find hard cuts: the layout changes at once, and not around.

    Motion, however fast, changes several frames in a row. A change of brightness alone, by a lamp or by the camera's
    exposure, is no cut. Of cuts that follow each other closely, each is one, because the frames beside it are still.

    Args:
        measures: Of the frames.

    Returns:
        Numbers of the first frames after cuts.
    """
    change = measures.layout_change
    sudden = _sudden(measures)
    cuts = []
    for i in np.flatnonzero(change > CUT):
        around = np.r_[max(i - NEIGHBOURS, 1) : i, i + 1 : min(i + 1 + NEIGHBOURS, len(change))]
        if sudden[i]:
            around = around[~sudden[around]]
        # The largest but one: another cut may be near.
        usual = np.sort(change[around])[-2] if len(around) > 2 else 0.0
        if change[i] > CUT_RATIO * usual:
            cuts.append(i)
    return np.array(cuts, int)


def _sudden(measures: FrameMeasures) -> Bool[np.ndarray, " n"]:
    """Frames whose layout changes at once, and that of the frames beside them does not; repeated frames do not count.

    A recorder that repeats every other frame would make all of a motion sudden.
    """
    change, found = measures.layout_change, np.zeros(len(measures.change), bool)
    new = np.flatnonzero(~repeated_frames(measures))
    beside = np.maximum(np.r_[0, change[new][:-1]], np.r_[change[new][1:], 0])
    found[new] = (change[new] > CUT) & (change[new] > CUT_RATIO * beside)
    return found


def repeated_frames(measures: FrameMeasures) -> Bool[np.ndarray, " n"]:
    """Find frames that show what the frame before shows: recorders repeat frames when they are late.

    Args:
        measures: Of the frames.

    Returns:
        Whether each frame repeats the one before.
    """
    usual = np.median(measures.change[1:]) if len(measures.change) > 1 else 0.0
    return measures.change < min(SAME, max(SAME_SHARE * usual, 0.02))


def frozen_stretches(measures: FrameMeasures) -> list[tuple[float, float]]:
    """Find stretches in which the picture stands still, as after a lost connection.

    Args:
        measures: Of the frames.

    Returns:
        First and last time of each, in seconds.
    """
    repeated = np.r_[False, repeated_frames(measures)[1:], False]
    edges = np.flatnonzero(np.diff(repeated.astype(int)))
    stretches = [(_time(measures.times, a), _time(measures.times, b)) for a, b in edges.reshape(-1, 2)]
    return [(start, end) for start, end in stretches if end - start >= FROZEN_SECONDS]


def _time(times: Float[np.ndarray, " n"], number: int) -> float:
    return float(times[number])
