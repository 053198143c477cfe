"""Plots of the benchmarks, from their records alone."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from evaluation.benchmarks.measurement.timing import Measurement
from evaluation.figures.png_figure import png_figure

COLOURS = {"plain loops": "0.6", "carigs": "tab:blue"}
SCALING = r"(?P<surfels>\d+) surfels, (?P<height>\d+)x(?P<width>\d+), (?P<threads>\d) threads?"
WARP = re.compile(r"(?P<warp>affine|perspective), (?P<samples>\d)x\d")


def plot_splat(file: Path, measurements: Sequence[Measurement], kernels: Sequence[str]) -> None:
    """Plot the surfel engine: kernels beside plain loops, and time against surfels and pixels.

    Args:
        file: PNG file to write.
        measurements: Records of `evaluation.benchmarks.splat`.
        kernels: Names of the kernels.
    """
    table = pd.DataFrame(measurements).rename(columns={"value": "carigs", "reference": "plain loops"})
    scaling = table[table["quantity"] == "forward and backward"]
    scaling = scaling.join(scaling["case"].str.extract(SCALING).astype(int))
    scaling["pixels"] = scaling["width"] * scaling["height"]
    with png_figure(file, (11.0, 7.6)) as figure:
        top, bottom = figure.subplots(2, 2)
        for axes, scene in zip(top, ("normal", "dense"), strict=True):
            shown = table[table["quantity"].isin(kernels) & table["case"].str.endswith(f", {scene}")]
            bars = shown.set_index(shown["quantity"].str.replace(" ", "\n"))[list(COLOURS)]
            bars.plot.bar(ax=axes, color=COLOURS, rot=0, width=0.8, xlabel="", ylabel="CPU ms, 1 thread")
            for container in axes.containers:
                axes.bar_label(container, fmt="%.3g", fontsize=8)
            axes.set_title(shown["case"].iloc[0], fontsize=10)
        for axes, x, fixed in zip(bottom, ("surfels", "pixels"), ("pixels", "surfels"), strict=True):
            # The scenes that differ in nothing but x.
            common = scaling[fixed].mode()[0]
            _draw_scaling(axes, x, scaling[scaling[fixed] == common].sort_values(x))
            axes.set_title(f"{common:,} {fixed}: rendering and gradient", fontsize=10)


def plot_surface(file: Path, measurements: Sequence[Measurement], typical: str, presets: Sequence[str]) -> None:
    """Plot the exaggeration: solvers, paths and curvature above; bounds of the blend error and lids below.

    Args:
        file: PNG file to write.
        measurements: Records of `evaluation.benchmarks.surface`.
        typical: Name of the head whose bounds are drawn.
        presets: Names of the two presets.
    """
    with png_figure(file, (15.0, 8.6), dpi=100) as figure:
        (solvers, paths, curvature), (*bounds, lids) = figure.subplots(2, 3)
        shown = r"(?P<x>\d+) vertices, (.*); 32 levels"
        _draw_curves(solvers, measurements, shown, "vertices", "CPU s", "factorise and solve 32 levels")
        shown, label = r"(.*); largest error of a path of (?P<x>\d+) nodes", "largest error (diagonals)"
        _draw_curves(paths, measurements, shown, "nodes of the path", label, "paths against exact solves")
        paths.set_xscale("linear")
        # The torus with an even grid is left out: every estimator is accurate there.
        shown = r"((?!torus, ).*), (?P<x>\d+) vertices; error of K: (.*)"
        _draw_curves(curvature, measurements, shown, "vertices", "relative rms error", "Gaussian curvature")
        curvature.set_ylim(top=30)  # room for the legend
        for axes, preset in zip(bounds, presets, strict=True):
            name, title = re.escape(f"{typical}, {preset}; "), f"rms error of the linear blend, {preset}"
            shown = rf"{name}(rms error of the blend|bound of that error, .*) at level (?P<x>[\d.]+)"
            _draw_curves(axes, measurements, shown, r"caricature level $\gamma$", "diagonals", title)
            axes.set_xscale("linear")
        _draw_lids(lids, [m for m in measurements if m.quantity.startswith("lids closed")])


def plot_target(file: Path, measurements: Sequence[Measurement]) -> None:
    """Plot the error of GT* targets against their time, one point per set of options.

    Args:
        file: PNG file to write.
        measurements: Records of `evaluation.benchmarks.target`.
    """
    table = pd.DataFrame(measurements)
    values = table.pivot(index="case", columns="quantity", values="value")
    with png_figure(file, (7.0, 4.2)) as figure:
        axes = figure.subplots()
        for case in table["case"].unique():
            if option := WARP.fullmatch(case):
                axes.plot(
                    *values.loc[case, ["visibility, warp and masks", "99th percentile of the error"]],
                    "os^D"[int(option["samples"]).bit_length() - 1],
                    color="tab:blue" if option["warp"] == "perspective" else "0.6",
                    fillstyle="none", label=case,
                )  # fmt: skip
        axes.set(xscale="log", xlabel="CPU ms per frame of 802x550, one thread")
        axes.set_ylabel("99th percentile of |target - truth|, trusted pixels")
        axes.grid(alpha=0.3, which="both")
        axes.legend(fontsize=7)


def plot_quality(file: Path, measurements: Sequence[Measurement]) -> None:
    """Plot PSNR of the full image and of the face against the CPU time of the training, a line per level.

    Args:
        file: PNG file to write.
        measurements: Records of `evaluation.benchmarks.quality`.
    """
    table = pd.DataFrame(measurements).pivot(index="case", columns="quantity", values="value")
    table = table.dropna(subset="CPU time").sort_values("CPU time")
    with png_figure(file, (7.0, 4.5)) as figure:
        axes = figure.subplots()
        for quantity in table.columns:
            if match := re.fullmatch("PSNR at (level .*, )(full|face)", quantity):
                style, colour = ("o-", "s--")[match[2] == "face"], "C1" if match[1] != "level 0, " else "C0"
                axes.plot(table["CPU time"], table[quantity], style, color=colour, label=match[1] + match[2])
        axes.set(xscale="log", xlabel="CPU seconds of training", ylabel="PSNR in dB")
        axes.xaxis.set_major_formatter("{x:g}")
        axes.xaxis.set_minor_formatter("{x:g}")
        axes.grid(alpha=0.3, which="both")
        axes.legend(fontsize=8, frameon=False)


def _draw_scaling(axes: Any, x: str, scaling: pd.DataFrame) -> None:
    for threads, style in ((1, "o-"), (2, "s--")):
        shown = scaling[scaling["threads"] == threads].set_index(x)[list(COLOURS)]
        shown = shown.add_suffix(f", {threads} thread{'s' * (threads > 1)}")
        shown.plot(ax=axes, style=style, color=list(COLOURS.values()), loglog=True, ylabel="wall ms")
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8)


def _draw_curves(
    axes: Any, measurements: Sequence[Measurement], pattern: str, xlabel: str, ylabel: str, title: str
) -> None:
    """Draw the records whose "case; quantity" matches: group x is the abscissa, the others make the label."""
    curves: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for m in measurements:
        if match := re.fullmatch(pattern, f"{m.case}; {m.quantity}"):
            x = match.re.groupindex["x"]
            label = ": ".join(text for number, text in enumerate(match.groups(), start=1) if number != x)
            curves[label].append((float(match["x"]), m.value))
    for name, points in curves.items():
        axes.plot(*zip(*sorted(points), strict=True), "o-", markersize=3, label=name)
    axes.set(xscale="log", yscale="log", xlabel=xlabel, ylabel=ylabel)
    axes.set_title(title, fontsize=10)
    axes.grid(alpha=0.3)
    if curves:
        axes.legend(fontsize=6)


def _draw_lids(axes: Any, measurements: Sequence[Measurement]) -> None:
    """One dot for each person: closure relative to the natural one."""
    closures: dict[str, list[float]] = defaultdict(list)
    for m in measurements:
        closures["\n".join(name.split(", ")[1] for name in (m.case, m.quantity))].append(m.value / m.reference)
    for kind in sorted(closures, reverse=True):
        axes.plot([kind] * len(closures[kind]), closures[kind], "o", alpha=0.4, color="tab:blue")
    axes.axhspan(0.85, 1.15, color="tab:green", alpha=0.15)
    axes.axhline(1, color="k", linewidth=0.6)
    axes.tick_params(axis="x", labelsize=8)
    axes.set_title("lids under a full blink: closure / natural closure", fontsize=10)
    axes.grid(alpha=0.3, axis="y")
