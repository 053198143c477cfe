"""Error of interpolated caricatures over the level: the paper's linear blend (equation 7) and the stored path."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from carigs.exaggeration import GammaPath
from evaluation.figures.png_figure import png_figure
from evaluation.figures.style import TEXT_WIDTH

STYLES = {
    "blend_largest": ("linear blend, largest", "C0-"),
    "blend_rms": ("linear blend, rms", "C0--"),
    "path_largest": ("stored path, largest", "C1-"),
    "path_rms": ("stored path, rms", "C1--"),
    "bound": (r"$\propto \gamma(\gamma_f - \gamma)$", "k:"),
}


class BlendError(NamedTuple):
    """Distances of vertices from the exact solution at one level, in bounding-box diagonals of the neutral head."""

    level: float
    blend_largest: float
    """Linear blend of S_0 and S_gamma_f: largest distance."""
    blend_rms: float
    path_largest: float
    """Stored path: largest distance."""
    path_rms: float


def blend_errors(path: GammaPath, exact: Callable[[float], Float[np.ndarray, "v 3"]], samples: int) -> list[BlendError]:
    """Compare the linear blend and the stored path with exact solutions.

    The linear blend is equation 7 of the paper: S_gamma ~ (1 - gamma / gamma_f) S_0 + (gamma / gamma_f) S_gamma_f.

    Args:
        path: The stored path.
        exact: Displacement in metres that the solver gives for a level.
        samples: Number of levels, evenly from 0 to gamma_f.

    Returns:
        Errors at each level.
    """
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


def plot_blend_errors(file: Path, errors: Sequence[BlendError]) -> None:
    """Draw the curves on a linear axis, as the paper, and on a logarithmic one.

    The shape of the paper's bound (equation 9), gamma (gamma_f - gamma), is scaled to the blend's largest error.

    Args:
        file: PNG file to write, with a PDF file beside it.
        errors: Errors at each level.
    """
    levels = np.array([error.level for error in errors])
    percent = {name: 100 * np.array([getattr(error, name) for error in errors]) for name in BlendError._fields[1:]}
    shape = levels * (levels[-1] - levels)
    percent["bound"] = shape * percent["blend_largest"].max() / shape.max()
    with png_figure(file, (TEXT_WIDTH, 2.5), dpi=200, vector=True) as figure:
        for axes, scale in zip(figure.subplots(1, 2), ("linear", "log"), strict=True):
            for name, (label, style) in STYLES.items():
                # Errors are exactly 0 at the nodes, which a logarithmic axis cannot show.
                values = percent[name] if scale == "linear" else np.where(percent[name] > 1e-12, percent[name], np.nan)
                axes.plot(levels, values, style, label=label)
            axes.set(yscale=scale, xlabel=r"caricature level $\gamma$", xlim=(0, levels[-1]))
            axes.grid()
            if scale == "linear":
                axes.set(ylabel="distance from the exact solution\n(% of the bounding-box diagonal)", ylim=(0, None))
            else:
                axes.legend(loc="lower center")
