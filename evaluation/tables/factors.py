"""The random factors of a mean over frames: what else could have been captured."""

from __future__ import annotations

from typing import Any

import numpy as np
from jaxtyping import Shaped

FRAME = ["subject", "timestep", "camera"]
"""Columns of the records that identify a frame."""
MAX_BLOCKS = 10
"""Blocks of a sequence of frames: neighbours are alike, and count as one where there is no other subject."""


def crossed_factors(frames: Any, protocol: str) -> list[Shaped[np.ndarray, " n"]]:
    """List the factors whose levels vary independently, for `evaluation.tables.bootstrap.mean_interval`.

    What lies within a subject, such as its timesteps, is part of the spread between subjects where there are several.
    Within one subject, neighbours in time or on the orbit are alike: blocks of them are the levels (method of batch
    means; Ibragimov and Mueller 2010, "t-statistic based correlation and heterogeneity robust inference").

    Args:
        frames: Columns `FRAME` of n frames, as a data frame or a mapping.
        protocol: Their protocol; the cameras of the protocol `orbit` are places on a trajectory.

    Returns:
        For each factor the label of every frame.
    """
    subject, timestep, camera = (np.asarray(frames[name]) for name in FRAME)
    if (subject != subject[:1]).any():
        return [subject, camera]
    return [_blocks(timestep), _blocks(camera) if protocol == "orbit" else camera]


def _blocks(places: Shaped[np.ndarray, " n"]) -> Shaped[np.ndarray, " n"]:
    """The block of each place; at most `MAX_BLOCKS`, of neighbouring places."""
    distinct, rank = np.unique(places, return_inverse=True)
    return rank * min(MAX_BLOCKS, len(distinct)) // len(distinct)
