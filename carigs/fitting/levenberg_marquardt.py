"""Levenberg-Marquardt minimisation of a fit's objective."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Float

from carigs.fitting.normal_equations import NormalEquations

DAMPING = 1e-3
LARGEST_DAMPING = 1e8


class Minimised(Protocol):
    """A cost of the parameters of frames and of what they share; `carigs.fitting.objective.Objective` is one."""

    def value(self, frames: Float[np.ndarray, "t q"], shape: Float[np.ndarray, " s"]) -> float:
        """Evaluate.

        Args:
            frames: Parameters of each frame.
            shape: Shared parameters.

        Returns:
            The cost.
        """

    def linearise(
        self, frames: Float[np.ndarray, "t q"], shape: Float[np.ndarray, " s"]
    ) -> tuple[float, NormalEquations]:
        """Evaluate, with the normal equations.

        Args:
            frames: Parameters of each frame.
            shape: Shared parameters.

        Returns:
            The cost, and the Gauss-Newton matrix with the gradient.
        """


class Bounds(NamedTuple):
    """Least and largest values of the parameters of a frame; infinite where there is none."""

    low: Float[np.ndarray, " q"]
    high: Float[np.ndarray, " q"]


def minimise(
    objective: Minimised,
    frames: Float[np.ndarray, "t q"],
    shape: Float[np.ndarray, " s"],
    *,
    steps: int = 50,
    tolerance: float = 1e-6,
    bounds: Bounds | None = None,
    on_step: Callable[[int, float], None] = lambda step, cost: None,
) -> tuple[Float[np.ndarray, "t q"], Float[np.ndarray, " s"]]:
    """Minimise by damped Gauss-Newton steps (Levenberg 1944, Marquardt 1963).

    A step that reduces the cost is taken. By how much less than predicted it does so tells whether the next one is
    damped less, down to a third, or more (Nielsen 1999). Any other step multiplies the damping by 3. Robust losses
    enter through their weights at the current point (iteratively reweighted least squares). Parameters at a bound that
    would leave it are held for the step, and steps end at the bounds (projected Newton, Bertsekas 1982).

    Args:
        objective: The objective.
        frames: Start: parameters of each frame.
        shape: Start: shape coefficients.
        steps: Largest number of steps.
        tolerance: The search ends when a step reduces the cost by less than this share.
        bounds: Of the frames' parameters, which the start keeps; None for none.
        on_step: Called with the number and the cost of each step.

    Returns:
        The parameters of the least cost.
    """
    low, high = bounds or (-np.inf, np.inf)
    damping = DAMPING
    cost, equations = objective.linearise(frames, shape)
    for step in range(steps):
        if bounds is not None:
            gradient = equations.frame_gradient
            equations.hold(((frames <= low) & (gradient > 0)) | ((frames >= high) & (gradient < 0)))
        while True:
            try:
                frame_step, shape_step = equations.solve(damping)
                moved = np.clip(frames + frame_step, low, high), shape + shape_step
                trial = objective.value(*moved)
            except np.linalg.LinAlgError:
                trial = np.inf
            if trial < cost:
                break
            damping *= 3
            if damping > LARGEST_DAMPING:
                return frames, shape
        frames, shape = moved
        ratio = (cost - trial) / equations.predicted_fall(frame_step, shape_step, damping)
        damping = max(damping * max(1 / 3, 1 - (2 * ratio - 1) ** 3), 1e-9)
        on_step(step, trial)
        if cost - trial <= tolerance * cost:
            break
        cost, equations = objective.linearise(frames, shape)
    return frames, shape
