"""Order in which training takes real frames and GT* targets."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Int


class Schedule(NamedTuple):
    """Training example of every step; drawn before the first step, so that a resumed run sees the same order.

    Attributes:
        gtstar: Whether the step takes a GT* target, not a real frame.
        index: Index of the frame or target.
    """

    gtstar: Bool[np.ndarray, " n"]
    index: Int[np.ndarray, " n"]


def draw_schedule(iterations: int, frames: int, targets: int, gtstar_probability: float, seed: int) -> Schedule:
    """Draw the random alternation of real frames and GT* targets.

    The alternation of the paper: each step takes a GT* target with probability `gtstar_probability`, else a real frame,
    independently of the other steps (Bernoulli draws). Real frames and targets each come in epochs: every example once
    in random order before any comes again.

    Args:
        iterations: Number of steps.
        frames: Number of real frames.
        targets: Number of GT* targets, of all levels together.
        gtstar_probability: Probability of a GT* target, in [0, 1].
        seed: Seed of the draws.

    Returns:
        The example of every step.
    """
    rng = np.random.default_rng([seed, 0])
    gtstar = rng.random(iterations) < gtstar_probability
    index = np.zeros(iterations, np.int64)
    for is_target, count in ((False, frames), (True, targets)):
        steps = np.flatnonzero(gtstar == is_target)
        if len(steps):
            epochs = -(-len(steps) // count)
            index[steps] = np.concatenate([rng.permutation(count) for _ in range(epochs)])[: len(steps)]
    return Schedule(gtstar, index)
