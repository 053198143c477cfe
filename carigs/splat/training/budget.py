"""Number of steps that fit into a budget of CPU time, measured on this machine with the subject's own images."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

from carigs.settings import Train

WARM_UP, MEASURED = 8, 24
"""Steps before the measurement, which load or compile kernels, and measured steps."""
TRIAL_STEPS = WARM_UP + MEASURED
LEAST_STEPS = 50
"""Of a training with a budget, however small."""


def seconds_per_step(step: Callable[[], object], clock: Callable[[], float]) -> float:
    """Measure the mean time of a step.

    Args:
        step: Does one step.
        clock: Gives the time in seconds.

    Returns:
        Seconds.
    """
    for _ in range(WARM_UP):
        step()
    started = clock()
    for _ in range(MEASURED):
        step()
    return (clock() - started) / MEASURED


def with_iterations(settings: Train, iterations: int) -> Train:
    """Give a training another length: what happens at a step happens after the same share of the steps.

    Args:
        settings: Settings of the training.
        iterations: Number of steps.

    Returns:
        The settings, without a budget.
    """
    factor = iterations / settings.iterations

    def scaled(step: int) -> int:
        return max(1, round(step * factor)) if step else 0

    density = settings.density
    density = replace(
        density, start=scaled(density.start), stop=scaled(density.stop), every=scaled(density.every),
        reset_every=scaled(density.reset_every),
    )  # fmt: skip
    return replace(settings, iterations=iterations, budget=None, density=density)
