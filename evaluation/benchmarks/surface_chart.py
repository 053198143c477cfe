"""The plot of the exaggeration's benchmark."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from carigs.files import writing
from evaluation.benchmarks.measurements import Measurement
from evaluation.benchmarks.surface_accuracy import BOUNDS, PRESETS

SIZED = re.compile(r"(?:(?P<what>[^,].*), )?(?P<vertices>\d+) vertices(?:, (?P<way>.*))?")
NODES = re.compile(r"largest error of a path of (?P<nodes>\d+) nodes")
LEVEL = re.compile(r"(?P<what>.*) at level (?P<level>[\d.]+)")

Curves = dict[str, list[tuple[float, float]]]


def plot(file: Path, rows: Sequence[Measurement], typical: str) -> None:
    """Write the PNG: solvers, paths and curvature above, the blend's bounds on the head `typical` and lids below."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(15.0, 8.6), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    (solvers, paths, curvature), (*bounds, lids) = figure.subplots(2, 3)
    _draw(solvers, _by_size(rows, "32 levels"), "vertices", "CPU s", "factorise and solve 32 levels")
    _draw(paths, _by_nodes(rows), "nodes of the path", "largest error (diagonals)", "paths against exact solves")
    paths.set_xscale("linear")
    rough = [row for row in rows if not row.case.startswith("torus, ")]  # the even one flatters
    _draw(curvature, _by_size(rough, "error of K: "), "vertices", "relative rms error", "Gaussian curvature")
    curvature.set_ylim(top=30)  # room for the legend
    for axes, name in zip(bounds, PRESETS, strict=True):
        curves = _by_level([row for row in rows if row.case == f"{typical}, {name}"])
        _draw(axes, curves, r"caricature level $\gamma$", "diagonals", f"rms error of the linear blend, {name}")
        axes.set_xscale("linear")
    _draw_lids(lids, [row for row in rows if row.quantity.startswith("lids closed")])
    with writing(file) as part:
        figure.savefig(part, metadata={"Software": None})


def _draw(axes: Any, curves: Curves, across: str, up: str, title: str) -> None:
    for name, points in curves.items():
        axes.plot(*zip(*sorted(points), strict=True), "o-", markersize=3, label=name)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel(across)
    axes.set_ylabel(up)
    axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.3)
    if curves:
        axes.legend(fontsize=6)


def _by_size(rows: Sequence[Measurement], quantity: str) -> Curves:
    curves: Curves = defaultdict(list)
    for row in rows:
        found = SIZED.fullmatch(row.case)
        if found and row.quantity.startswith(quantity):
            name = ": ".join(filter(None, (found["what"], found["way"], row.quantity.removeprefix(quantity))))
            curves[name].append((int(found["vertices"]), row.value))
    return curves


def _by_nodes(rows: Sequence[Measurement]) -> Curves:
    curves: Curves = defaultdict(list)
    for row in rows:
        if found := NODES.fullmatch(row.quantity):
            curves[row.case].append((int(found["nodes"]), row.value))
    return curves


def _by_level(rows: Sequence[Measurement]) -> Curves:
    curves: Curves = defaultdict(list)
    for row in rows:
        found = LEVEL.fullmatch(row.quantity)
        if found and found["what"] in ("rms error of the blend", *BOUNDS.values()):
            curves[found["what"]].append((float(found["level"]), row.value))
    return curves


def _draw_lids(axes: Any, rows: Sequence[Measurement]) -> None:
    """One dot for each person: closure relative to the natural one."""
    kinds = sorted({(row.case.split(", ")[1], row.quantity.split(", ")[1]) for row in rows}, reverse=True)
    for place, (preset, transport) in enumerate(kinds):
        here = [row for row in rows if row.case.endswith(f", {preset}") and row.quantity.endswith(f", {transport}")]
        axes.plot([place] * len(here), [row.value / row.reference for row in here], "o", alpha=0.4, color="tab:blue")
    axes.axhspan(0.85, 1.15, color="tab:green", alpha=0.15)
    axes.axhline(1, color="k", linewidth=0.6)
    axes.set_xticks(range(len(kinds)), ["\n".join(kind) for kind in kinds], fontsize=8)
    axes.set_title("lids under a full blink: closure / natural closure", fontsize=10)
    axes.grid(alpha=0.3, axis="y")
