"""Levenberg-Marquardt minimisation of a fit's objective."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from carigs.fitting.objective import Objective

DAMPING = 1e-3
LARGEST_DAMPING = 1e8


def minimise(
    objective: Objective,
    frames: Float[np.ndarray, "t q"],
    shape: Float[np.ndarray, " s"],
    *,
    steps: int = 50,
    tolerance: float = 1e-6,
    on_step: Callable[[int, float], None] = lambda step, cost: None,
) -> tuple[Float[np.ndarray, "t q"], Float[np.ndarray, " s"]]:
    """Minimise by damped Gauss-Newton steps (Levenberg 1944, Marquardt 1963).

    A step that reduces the cost is taken and divides the damping by 10; any other multiplies it by 4. Robust losses
    enter through their weights at the current point (iteratively reweighted least squares).

    Args:
        objective: The objective.
        frames: Start: parameters of each frame.
        shape: Start: shape coefficients.
        steps: Largest number of steps.
        tolerance: The search ends when a step reduces the cost by less than this share.
        on_step: Called with the number and the cost of each step.

    Returns:
        The parameters of the least cost.
    """
    damping = DAMPING
    cost, equations = objective.linearise(frames, shape)
    for step in range(steps):
        while True:
            try:
                frame_step, shape_step = equations.solve(damping)
                trial = objective.value(frames + frame_step, shape + shape_step)
            except np.linalg.LinAlgError:
                trial = np.inf
            if trial < cost:
                break
            damping *= 4
            if damping > LARGEST_DAMPING:
                return frames, shape
        frames, shape = frames + frame_step, shape + shape_step
        damping = max(damping / 10, 1e-9)
        on_step(step, trial)
        if cost - trial <= tolerance * cost:
            break
        cost, equations = objective.linearise(frames, shape)
    return frames, shape
