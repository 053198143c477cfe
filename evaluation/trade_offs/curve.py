"""Curves of error against time over the values of a setting."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Float

from carigs.errors import InputError
from evaluation.trade_offs.knee import TOLERANCE, cost, knee, pareto_optimal

ON, BELOW, ABOVE = "on the knee", "below the knee", "above the knee"
"""Where a default lies. Below the knee more time would pay, above it time could be saved."""
SAME_TIME = 0.9
"""Ratio of two times that may be equal."""

LONGEST_LABEL = 8
"""Characters of a label beside a point of a figure."""


class Choice(NamedTuple):
    """One value of a setting."""

    label: str
    seconds: float
    error: float
    """PSNR in dB, or an error; see `Knob.is_psnr`."""


@dataclass(frozen=True)
class Curve:
    """The values of a setting, with their times and one kind of error, the fastest first."""

    name: str
    """What the error is of, for example `level 0`."""
    choices: tuple[Choice, ...]
    default: str
    """Label of the default."""
    is_psnr: bool = False
    """Whether errors are PSNR, and not numbers to be small."""
    needed: float = 0.0
    """Error below which nothing more is gained."""

    @cached_property
    def seconds(self) -> Float[np.ndarray, " n"]:
        """Time of each choice."""
        return np.array([choice.seconds for choice in self.choices], np.float64)

    @cached_property
    def decibels(self) -> Float[np.ndarray, " n"]:
        """Error of each choice in dB: minus PSNR, or 20 log10."""
        errors = np.array([choice.error for choice in self.choices], np.float64)
        return -errors if self.is_psnr else 20 * np.log10(np.maximum(errors, max(self.needed, 1e-300)))

    @property
    def times(self) -> dict[str, float]:
        """Time of each choice, by its label."""
        return {choice.label: choice.seconds for choice in self.choices}

    @property
    def default_index(self) -> int:
        """Place of the default among the choices."""
        return [choice.label for choice in self.choices].index(self.default)

    @property
    def knee_index(self) -> int:
        """Place of the knee."""
        return knee(self.seconds, self.decibels)

    @property
    def optimal(self) -> np.ndarray:
        """Whether each choice is Pareto-optimal."""
        return pareto_optimal(self.seconds, self.decibels)

    @property
    def position(self) -> str:
        """Where the default lies."""
        costs, at, best = cost(self.seconds, self.decibels), self.default_index, self.knee_index
        if costs[at] - costs[best] <= TOLERANCE:
            return ON
        more_accurate = self.decibels[best] < self.decibels[at]
        return BELOW if more_accurate and self.seconds[best] > SAME_TIME * self.seconds[at] else ABOVE


def make_curve(
    name: str, choices: Sequence[Choice], default: str, *, is_psnr: bool = False, needed: float = 0.0
) -> Curve:
    """Sort choices into a curve.

    Args:
        name: What the error is of.
        choices: Values of the setting.
        default: Label of the default.
        is_psnr: Whether errors are PSNR.
        needed: Error below which nothing more is gained.

    Returns:
        The curve.
    """
    return Curve(name, tuple(sorted(choices, key=lambda choice: choice.seconds)), default, is_psnr, needed)


@dataclass(frozen=True)
class Knob:
    """A setting whose trade-off is shown."""

    stage: str
    setting: str
    """Key of the settings, or what else is varied."""
    table: str
    """Benchmark that measures it: the name of its CSV file."""
    time: str
    """What takes the time."""
    error: str
    """What the error is."""
    curves: Callable[[pd.DataFrame], list[Curve]]
    """Reads its curves from the records."""
    note: str = ""
    """What else a reader must know."""
    reasons: Mapping[str, str] = field(default_factory=dict)
    """Why the default lies off the knee, by its position (`BELOW`, `ABOVE`)."""

    def read(self, tables: Mapping[str, pd.DataFrame]) -> list[Curve]:
        """Read the curves.

        Args:
            tables: Records by benchmark.

        Returns:
            The curves.

        Raises:
            InputError: Records are missing, such as those of another version, or that of the default.
        """
        file, missing = f"{self.table}.csv", "its records are missing; run the benchmark again"
        try:
            curves = self.curves(tables[self.table])
        except (KeyError, IndexError, StopIteration) as error:
            raise InputError(missing, file=file, field=self.setting) from error
        if not curves:
            raise InputError(missing, file=file, field=self.setting)
        for curve in curves:
            labels = [choice.label for choice in curve.choices]
            if curve.default not in labels:
                problem = f"the default {curve.default} was not measured; measured: {', '.join(labels) or 'nothing'}"
                raise InputError(problem, file=file, field=self.setting)
            if len(labels) < 2:  # the default would be the knee of nothing
                raise InputError(f"only the default {curve.default} was measured", file=file, field=self.setting)
        return curves


def short_labels(curves: Sequence[Curve]) -> dict[str, str]:
    """Names of the choices for figures.

    Args:
        curves: Curves of one setting.

    Returns:
        Short name of each label, in the order of the first curve: the label itself, or its number if one is long.
    """
    labels = list(dict.fromkeys(choice.label for curve in curves for choice in curve.choices))
    if max(map(len, labels)) <= LONGEST_LABEL:
        return {label: label for label in labels}
    return {label: f"{number}" for number, label in enumerate(labels, start=1)}
