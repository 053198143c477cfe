"""Figures of the trade-offs: error against time, one panel per setting."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Any

import numpy as np

from evaluation.figures.png_figure import png_figure
from evaluation.figures.style import MARKERS, PALETTE, SMALL, TEXT_WIDTH
from evaluation.trade_offs.curve import Curve, Knob, short_labels

COLUMNS, PANEL_HEIGHT, LEGEND_HEIGHT = 2, 2.3, 0.3
"""Panels side by side, and heights in inches."""
LEGEND_ROOM = 0.2
"""Part of a panel's height that is added above for each curve but the first."""
FEW_TICKS, FINE_TICKS = 30, 3
"""Ratios of the ends of an axis below which its ticks are not powers of ten, and lie close together."""
KEY = "ring: default    filled: knee    further down: less error"
RING = {"color": "black", "fillstyle": "none", "markersize": 9, "markeredgewidth": 0.8}


def draw_trade_offs(file: Path, shown: Sequence[tuple[Knob, Sequence[Curve]]]) -> None:
    """Draw the curves of a stage. Errors are in dB relative to that of the default.

    Args:
        file: PNG file to write; a PDF goes beside it.
        shown: Settings with their curves.
    """
    rows = -(-len(shown) // COLUMNS)
    size = TEXT_WIDTH, rows * PANEL_HEIGHT + LEGEND_HEIGHT
    with png_figure(file, size, dpi=160, vector=True) as figure:
        for axes, panel in zip_longest(figure.subplots(rows, COLUMNS, squeeze=False).flat, shown):
            if panel is None:
                axes.set_axis_off()
            else:
                _draw_panel(axes, *panel)
        figure.supxlabel(KEY, fontsize="medium")
        figure.supylabel("error relative to the default, dB", fontsize="medium")


def _draw_panel(axes: Any, knob: Knob, curves: Sequence[Curve]) -> None:
    names, times = short_labels(curves), [curve.times for curve in curves]
    for number, (curve, colour, marker) in enumerate(zip(curves, PALETTE, MARKERS, strict=False)):
        seconds, errors = curve.seconds, curve.decibels - curve.decibels[curve.default_index]
        optimal = curve.optimal
        axes.plot(seconds[optimal], errors[optimal], "-", color=colour, linewidth=0.8)
        axes.plot(seconds, errors, marker, color=colour, fillstyle="none", label=curve.name)
        axes.plot(seconds[curve.knee_index], errors[curve.knee_index], marker, color=colour)
        axes.plot(seconds[curve.default_index], errors[curve.default_index], "o", **RING)
        if number == 0 or times[number] != times[0]:
            for choice, error in zip(curve.choices, errors, strict=True):
                offset = {"xytext": (3, 4), "textcoords": "offset points"}
                axes.annotate(names[choice.label], (choice.seconds, error), **offset, fontsize=SMALL, color=colour)
    axes.set(xscale="log", xlabel=knob.time)
    axes.set_title(knob.setting)
    axes.margins(0.15, 0.2)
    _set_ticks(axes, np.concatenate([curve.seconds for curve in curves]))
    axes.grid()
    if len(curves) > 1:
        low, high = axes.get_ylim()
        axes.set_ylim(low, high + (len(curves) - 1) * LEGEND_ROOM * (high - low))
        axes.legend(frameon=False, handletextpad=0.2)


def _set_ticks(axes: Any, seconds: np.ndarray) -> None:
    """Few ticks with plain numbers on a short logarithmic axis."""
    from matplotlib.ticker import LogLocator, MaxNLocator, NullFormatter, NullLocator, StrMethodFormatter

    axes.xaxis.set_minor_formatter(NullFormatter())
    ratio = seconds.max() / seconds.min()
    if ratio < FEW_TICKS:
        axes.xaxis.set_major_locator(MaxNLocator(4) if ratio < FINE_TICKS else LogLocator(subs=(1, 2, 5)))
        axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
        axes.xaxis.set_minor_locator(NullLocator())
