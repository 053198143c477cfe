"""The plot of the surfel engine's benchmark: kernels beside plain loops, and time against surfels and pixels."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from carigs.files import writing
from evaluation.benchmarks.clocks import KERNELS
from evaluation.benchmarks.measurements import Measurement

SCENE = re.compile(r"(?P<surfels>\d+) surfels, (?P<height>\d+)x(?P<width>\d+), (?P<threads>\d) threads?")
OURS, PLAIN = "tab:blue", "0.6"


class Timing(NamedTuple):
    """A scaling row, in numbers."""

    surfels: int
    pixels: int
    threads: int
    ours: float
    plain: float


def plot(file: Path, rows: Sequence[Measurement]) -> None:
    """Write the PNG of the rows of `evaluation.benchmarks.splat`."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 7.6), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    top, bottom = figure.subplots(2, 2)
    for axes, name in zip(top, ("normal", "dense"), strict=True):
        _draw_kernels(axes, [row for row in rows if row.quantity in KERNELS and row.case.endswith(f", {name}")])
    timings = [_timing(row) for row in rows if row.quantity == "forward and backward"]
    for axes, across, fixed in zip(bottom, ("surfels", "pixels"), ("pixels", "surfels"), strict=True):
        # The scenes in which all but what is on the axis is the same.
        same = Counter(getattr(timing, fixed) for timing in timings).most_common(1)[0][0]
        _draw_scaling(axes, across, [timing for timing in timings if getattr(timing, fixed) == same])
        axes.set_title(f"{same:,} {fixed}: rendering and gradient", fontsize=10)
    with writing(file) as part:
        figure.savefig(part, metadata={"Software": None})


def _timing(row: Measurement) -> Timing:
    numbers = {name: int(text) for name, text in SCENE.fullmatch(row.case).groupdict().items()}
    pixels = numbers["width"] * numbers["height"]
    return Timing(numbers["surfels"], pixels, numbers["threads"], row.value, row.reference)


def _draw_kernels(axes: Any, rows: Sequence[Measurement]) -> None:
    place = np.arange(len(rows))
    for shift, label, colour, values in (
        (-0.2, "plain loops", PLAIN, [row.reference for row in rows]),
        (0.2, "carigs", OURS, [row.value for row in rows]),
    ):
        bars = axes.bar(place + shift, values, 0.4, color=colour, label=label)
        axes.bar_label(bars, [f"{value:.3g}" for value in values], fontsize=8)
    axes.set_xticks(place, [row.quantity.replace(" ", "\n") for row in rows])
    axes.set_ylabel("CPU ms, 1 thread")
    axes.set_title(rows[0].case, fontsize=10)
    axes.spines[["top", "right"]].set_visible(False)
    axes.legend(frameon=False)


def _draw_scaling(axes: Any, across: str, timings: Sequence[Timing]) -> None:
    for threads, style in ((1, "o-"), (2, "s--")):
        shown = sorted(timing for timing in timings if timing.threads == threads)
        x = [getattr(timing, across) for timing in shown]
        suffix = f"{threads} thread{'s' * (threads > 1)}"
        axes.plot(x, [timing.plain for timing in shown], style, color=PLAIN, label=f"plain loops, {suffix}")
        axes.plot(x, [timing.ours for timing in shown], style, color=OURS, label=f"carigs, {suffix}")
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(across)
    axes.set_ylabel("wall ms")
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8)
