"""Early end of a training whose images of held-out frames no longer improve.

The learning rates fall over the whole training, so that a training that is cut off ends with rates that are too high.
Where the quality has levelled off, the rest is therefore shortened instead: the rates fall to their last value within
a share of the steps that were done until then.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from carigs.capture import Capture, Frame
from carigs.capture.evenly_spread import evenly_spread
from carigs.settings import Train

FRAMES = 8
"""Held-out frames that are measured."""
COOLDOWN = 0.25
"""Steps that follow when the quality has levelled off, over those done: the learning rates fall within them."""
LEAST_MEASUREMENTS = 2
"""In each of the two quarters that are compared: the error of a single measurement is as large as late gains."""
MIN_GAIN = 0.03
"""PSNR in dB: the quality has levelled off where the last quarter of the steps gains less."""


class Ending(NamedTuple):
    """Where a training ends.

    Attributes:
        levelled_at: Number of steps after which the quality had levelled off; None if it has not.
        last: Number of all steps.
    """

    levelled_at: int | None
    last: int

    def progress(self, iteration: int, iterations: int) -> float:
        """Share of the learning rates' way from first to last value.

        Args:
            iteration: Index of a step, from 0.
            iterations: Number of steps of the settings.

        Returns:
            A number in [0, 1]: linear in the steps, and steeper after the quality has levelled off.
        """
        whole = max(iterations - 1, 1)
        if self.levelled_at is None or iteration < self.levelled_at:
            return iteration / whole
        before = (self.levelled_at - 1) / whole
        return before + (1 - before) * (iteration - self.levelled_at + 1) / (self.last - self.levelled_at)


def validation_frames(capture: Capture) -> list[Frame]:
    """Choose held-out frames.

    Args:
        capture: The captured subject.

    Returns:
        At most `FRAMES` frames of the split `val`, evenly over all; none if it is empty.
    """
    return evenly_spread([*capture.split("val")], FRAMES)


def measures_after(settings: Train, done: int) -> bool:
    """Whether the quality is measured after a step: while a plateau would still shorten the training.

    Args:
        settings: Settings of the training.
        done: Number of steps done.

    Returns:
        Whether it is a step of `train.plateau.every`, after density control, with time to save.
    """
    plateau, density = settings.plateau, settings.density
    if not plateau.every or done % plateau.every or (density.every and done < density.stop):
        return False
    return done + _cooldown(done) < settings.iterations


def has_levelled_off(measured: Sequence[tuple[int, float]], min_gain: float) -> bool:
    """Compare the quality in the last quarter of the steps with that in the quarter before.

    Args:
        measured: Numbers of steps, rising, and the PSNR (dB) after them.
        min_gain: Smallest difference of the two means (dB) that is an improvement.

    Returns:
        Whether the gain is smaller. False if one of the quarters has fewer than `LEAST_MEASUREMENTS`.
    """
    if not measured:
        return False
    done = measured[-1][0]
    last = [psnr for step, psnr in measured if 4 * step > 3 * done]
    before = [psnr for step, psnr in measured if 3 * done >= 4 * step > 2 * done]
    if min(len(last), len(before)) < LEAST_MEASUREMENTS:
        return False
    return float(np.mean(last) - np.mean(before)) < min_gain


def ending_after(settings: Train, measured: Sequence[tuple[int, float]]) -> Ending:
    """Decide where a training ends after its last measurement.

    Args:
        settings: Settings of the training.
        measured: As in `has_levelled_off`.

    Returns:
        The end of the settings, or an earlier one.
    """
    if not has_levelled_off(measured, MIN_GAIN):
        return Ending(None, settings.iterations)
    done = measured[-1][0]
    return Ending(done, min(done + _cooldown(done), settings.iterations))


def _cooldown(done: int) -> int:
    return max(1, math.ceil(COOLDOWN * done))
