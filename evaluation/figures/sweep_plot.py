"""The figure of a sweep: each measure against the values of the first key."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from evaluation.figures.png_figure import png_figure
from evaluation.figures.style import MARKERS, PALETTE, TEXT_WIDTH
from evaluation.tables.metric import Metric
from evaluation.tables.typeset import ARROWS

PANEL_WIDTH, PANEL_HEIGHT = 1.7, 1.4
"""Least width of a panel, and its height, in inches."""
COLUMNS = 3
"""Panels side by side where each measure has one."""
DASHES = ("-", "--")
MAX_CURVES = len(PALETTE) * len(DASHES)
"""Curves of a panel that can be told apart."""
LOG_RATIO = 20.0
"""The axis is logarithmic if the largest value is this many times the smallest."""
MAX_TICKS, MAX_LABEL = 6, 16
"""Values that are all marked on the axis, and characters of a category."""


class _Axis(NamedTuple):
    """Where the values of the first key are drawn."""

    places: dict[str, float]
    """Place of the text of each value."""
    is_numeric: bool
    """Otherwise the values are categories, at 0, 1, 2, ..."""


def plot_sweep(file: Path, table: pd.DataFrame, keys: Sequence[str], shown: Mapping[str, Metric]) -> None:
    """Draw every measure against the first key, with confidence intervals.

    With one key a measure has a panel with a curve per variant. With several keys it has a row of panels, one per
    variant, with a curve for each combination of values of the other keys. Values that are not all numbers are
    categories, whose points are not joined. After `MAX_CURVES` curves the others are left out, which the figure says.

    Args:
        file: PNG file to write, with a PDF file beside it.
        table: As made by `evaluation.tables.sweep_table.sweep_table`.
        keys: Keys with several values.
        shown: The measures.
    """
    variants = list(dict.fromkeys(table["variant"]))
    if len(keys) == 1:
        curves, columns = table["variant"], min(COLUMNS, len(shown))
        panels = [(name, "", table) for name in shown]
    else:
        others = [[f"{key}={value}" for value in table[key]] for key in keys[1:]]
        curves, columns = pd.Series(map(", ".join, zip(*others, strict=True)), index=table.index), len(variants)
        panels = [(name, variant, table[table["variant"] == variant]) for name in shown for variant in variants]
    names = list(dict.fromkeys(curves))
    axis, rows = _axis(table[keys[0]]), math.ceil(len(panels) / columns)
    size = (max(TEXT_WIDTH, PANEL_WIDTH * columns), PANEL_HEIGHT * rows + 0.5)
    with png_figure(file, size, dpi=200, vector=True) as figure:
        grid = figure.subplots(rows, columns, squeeze=False, sharey="row" if len(keys) > 1 else False).flat
        for number, (axes, (name, variant, lines)) in enumerate(zip(grid, panels, strict=False)):
            for curve, label in enumerate(names[:MAX_CURVES]):
                _draw_curve(axes, lines[curves[lines.index] == label], name, axis, curve, len(names))
            _mark_values(axes, axis)
            lowest = number + columns >= len(panels)
            axes.tick_params(labelbottom=lowest)
            axes.set_xlabel(keys[0] if lowest else "")
            axes.set_title(variant if number < columns else "")
            if number % columns == 0 or len(keys) == 1:
                axes.set_ylabel(_label(shown[name]))
        for axes in grid[len(panels) :]:
            axes.set_axis_off()
        legend = [_handle(curve, label, axis) for curve, label in enumerate(names[:MAX_CURVES])]
        title = f"{MAX_CURVES} of {len(names)} curves; the table has all" if len(names) > MAX_CURVES else None
        widest = max(len(label) for label in names[:MAX_CURVES])
        figure.legend(handles=legend, loc="outside upper center", ncols=max(1, min(4, 80 // (widest + 6))), title=title)


def _axis(texts: Sequence[str]) -> _Axis:
    """Numbers at their places, other values in the order in which they appear."""
    values = list(dict.fromkeys(texts))
    try:
        numbers = {text: float(text) for text in values}
    except ValueError:
        numbers = {}
    if numbers and all(map(math.isfinite, numbers.values())):
        return _Axis(numbers, True)
    return _Axis({text: float(place) for place, text in enumerate(values)}, False)


def _style(curve: int, axis: _Axis) -> dict[str, Any]:
    """Colour, marker and dashes of a curve, which tell it apart together."""
    marker, colour = MARKERS[curve % len(MARKERS)], PALETTE[curve % len(PALETTE)]
    dashes = DASHES[curve // len(PALETTE) % len(DASHES)] if axis.is_numeric else "none"
    hollow = not axis.is_numeric and curve // len(PALETTE) % 2
    return {"color": colour, "marker": marker, "linestyle": dashes, "fillstyle": "none" if hollow else "full"}


def _handle(curve: int, label: str, axis: _Axis) -> Any:
    from matplotlib.lines import Line2D

    return Line2D([], [], label=label, **_style(curve, axis))


def _draw_curve(axes: Any, lines: pd.DataFrame, name: str, axis: _Axis, curve: int, count: int) -> None:
    """Draw the values of a measure with their intervals; those of categories beside each other."""
    beside = 0.0 if axis.is_numeric else 0.6 * ((curve + 0.5) / count - 0.5)
    places = lines.iloc[:, 0].map(axis.places) + beside
    order = np.argsort(places.to_numpy(), kind="stable")
    x = places.to_numpy()[order]
    values, low, high = (lines[f"{name}{part}"].to_numpy(float)[order] for part in ("", "_low", "_high"))
    style = _style(curve, axis)
    axes.plot(x, values, **style)
    known = ~np.isnan(low + high)
    if known.any():
        ends = np.maximum([values - low, high - values], 0.0)[:, known]
        axes.errorbar(x[known], values[known], ends, fmt="none", ecolor=style["color"], elinewidth=0.7, capsize=2)


def _mark_values(axes: Any, axis: _Axis) -> None:
    """Scale of the axis and its ticks."""
    places = list(axis.places.values())
    if axis.is_numeric:
        if min(places) > 0 and max(places) >= LOG_RATIO * min(places):
            axes.set_xscale("log")
        if len(places) <= MAX_TICKS:
            axes.set_xticks(places, [f"{place:g}" for place in places])
            axes.set_xticks([], minor=True)
    else:
        texts = [text if len(text) <= MAX_LABEL else f"{text[: MAX_LABEL - 3]}..." for text in axis.places]
        long = max(map(len, texts)) * len(texts) > 2 * MAX_LABEL
        axes.set_xticks(places, texts, rotation=30 if long else 0, ha="right" if long else "center")
        axes.set_xlim(-0.5, len(places) - 0.5)
    axes.grid()


def _label(metric: Metric) -> str:
    return f"{metric.title}{ARROWS[metric.better]}" + (f" ({metric.unit})" if metric.unit else "")
