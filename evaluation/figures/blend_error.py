"""How far interpolated surfaces are from the exactly solved one, over the caricature level."""

from __future__ import annotations

import csv
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from carigs.exaggeration import GammaPath
from carigs.files import writing

STYLES = {
    "blend_largest": ("linear blend, largest", "C0-"),
    "blend_rms": ("linear blend, rms", "C0--"),
    "path_largest": ("stored path, largest", "C1-"),
    "path_rms": ("stored path, rms", "C1--"),
    "bound": (r"$\propto \gamma(\gamma_f - \gamma)$", "k:"),
}


class BlendError(NamedTuple):
    """Distances between vertices at one level, in bounding-box diagonals of the neutral head."""

    level: float
    blend_largest: float
    """Of the paper's linear blend of S_0 and S_gamma_f from the exact solution."""
    blend_rms: float
    path_largest: float
    """Of the stored path from the exact solution."""
    path_rms: float


def blend_errors(path: GammaPath, exact: Callable[[float], Float[np.ndarray, "v 3"]], samples: int) -> list[BlendError]:
    """Errors at `samples` levels from 0 to gamma_f; `exact(level)` is the solver's displacement (metres)."""
    diagonal = float(np.linalg.norm(np.ptp(path.neutral, axis=0)))
    end = exact(path.gamma_f)
    errors = []
    for level in np.linspace(0, path.gamma_f, samples):
        solved = exact(float(level))
        numbers = []
        for approximation in (level / path.gamma_f * end, path.displacement(float(level))):
            distance = np.linalg.norm(approximation - solved, axis=1) / diagonal
            numbers += [float(distance.max()), float(np.sqrt((distance**2).mean()))]
        errors.append(BlendError(float(level), *numbers))
    return errors


def write_blend_errors(file: Path, errors: Sequence[BlendError]) -> None:
    """The curves as CSV."""
    with writing(file) as part, part.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(BlendError._fields)
        writer.writerows([f"{value:.6g}" for value in error] for error in errors)


def plot_blend_errors(file: Path, errors: Sequence[BlendError]) -> None:
    """The curves as PNG, linear as the paper draws them, and logarithmic.

    The shape of the paper's bound, gamma (gamma_f - gamma), is drawn through the blend's largest error.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    levels = np.array([error.level for error in errors])
    percent = {name: 100 * np.array([getattr(error, name) for error in errors]) for name in BlendError._fields[1:]}
    shape = levels * (levels[-1] - levels)
    percent["bound"] = shape * percent["blend_largest"].max() / shape.max()
    figure = Figure(figsize=(9.6, 4.0), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    for axes, scale in zip(figure.subplots(1, 2), ("linear", "log"), strict=True):
        for name, (label, style) in STYLES.items():
            # Errors are exactly 0 at the nodes, which a logarithmic axis cannot show.
            shown = percent[name] if scale == "linear" else np.where(percent[name] > 1e-12, percent[name], np.nan)
            axes.plot(levels, shown, style, label=label)
        axes.set_yscale(scale)
        axes.set_xlabel(r"caricature level $\gamma$")
        axes.set_xlim(0, levels[-1])
        axes.grid(alpha=0.3)
        if scale == "linear":
            axes.set_ylabel("distance from the exact solution\n(% of the bounding-box diagonal)")
            axes.set_ylim(bottom=0)
            axes.legend(fontsize=8)
    with writing(file) as part:
        figure.savefig(part, metadata={"Software": None})
