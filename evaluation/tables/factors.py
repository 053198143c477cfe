"""The random factors of a mean over frames: what else could have been captured, and how training could have gone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Shaped

FRAME = ["subject", "timestep", "camera", "seed"]
"""Columns of the records that identify a frame and the training that rendered it."""
MAX_BLOCKS = 10
"""Blocks of a sequence of frames: neighbours are alike, and count as one where there is no other subject."""


def crossed_factors(frames: Any, protocol: str) -> list[Shaped[np.ndarray, " n"]]:
    """List the factors whose levels vary independently, for `evaluation.tables.bootstrap.mean_interval`.

    What lies within a subject is part of the spread between subjects where there are several: its timesteps, and its
    trainings, because another subject's training with the same seed has other images and other surfels to draw from.
    Within one subject, neighbours in time or on the orbit are alike: blocks of them are the levels (method of batch
    means; Ibragimov and Mueller 2010, "t-statistic based correlation and heterogeneity robust inference").
    Every training of a subject renders all of its frames: seeds are crossed with timesteps and cameras.

    Args:
        frames: Columns `FRAME` of n frames, as a data frame or a mapping.
        protocol: Their protocol; the cameras of the protocol `orbit` are places on a trajectory.

    Returns:
        For each factor the label of every frame.
    """
    subject, timestep, camera, seed = (np.asarray(frames[name]) for name in FRAME)
    if (subject != subject[:1]).any():
        return [subject, camera]
    return [_blocks(timestep), _blocks(camera) if protocol == "orbit" else camera, seed]


def interval_scope(subjects: Sequence[str], seeds: int) -> str:
    """Say what varies at random between the values of a study, and so what its intervals cover.

    Args:
        subjects: Names of the subjects.
        seeds: Number of seeds that every variant was trained with.

    Returns:
        Sentences on the factors of `crossed_factors`.
    """
    several = seeds > 1
    trained = f"Each variant was trained with {seeds} seeds. " if several else "Each variant was trained once. "
    if len(subjects) == 1:
        factors = f"timesteps, in blocks of neighbours, {'cameras and seeds' if several else 'and cameras'}"
        other = "timesteps, cameras and trainings" if several else "timesteps and cameras"
        training = "" if several else " The intervals do not cover the randomness of training."
        return (
            f"{trained}One subject ({subjects[0]}): {factors} are random factors. The intervals say what other {other} "
            f"of this person would give, and nothing of other people.{training}"
        )
    training = "" if several else ", nor of the randomness of training"
    return (
        f"{trained}{len(subjects)} subjects: subjects and cameras are random factors; the timesteps and trainings of a "
        "subject are part of the spread between subjects. Intervals of one subject say nothing of other people"
        f"{training}."
    )


def _blocks(places: Shaped[np.ndarray, " n"]) -> Shaped[np.ndarray, " n"]:
    """The block of each place; at most `MAX_BLOCKS`, of neighbouring places."""
    distinct, rank = np.unique(places, return_inverse=True)
    return rank * min(MAX_BLOCKS, len(distinct)) // len(distinct)
