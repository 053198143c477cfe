"""The image figures: a variant over the levels beside the truth, and all variants beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from evaluation.figures.sheet import Image, write_sheet

ERROR_SCALE = 0.25  # absolute error (mean of the channels) that is drawn in the brightest colour


def gamma_strip(
    file: Path,
    variant: str,
    levels: Sequence[float],
    renders: Sequence[Image | None],
    truths: Sequence[Image | None],
    *,
    height: int,
) -> None:
    """One variant's renders at each level, the true images, and the error where there is a truth."""
    rows, images, footnote = [variant], [renders], ""
    if any(truth is not None for truth in truths):
        rows += ["truth", "error"]
        images += [truths, [error_map(*pair) for pair in zip(renders, truths, strict=True)]]
        footnote = f"error: mean absolute difference of the channels, black 0 to yellow {ERROR_SCALE:g} or more"
    write_sheet(file, images, rows=rows, columns=_names(levels), title=variant, height=height, footnote=footnote)


def ablation(
    file: Path,
    renders: dict[str, Sequence[Image | None]],
    levels: Sequence[float],
    truths: Sequence[Image | None],
    *,
    height: int,
) -> None:
    """Every variant's renders (rows) at each level (columns), above the true images."""
    rows, images = list(renders), list(renders.values())
    if any(truth is not None for truth in truths):
        rows, images = [*rows, "truth"], [*images, truths]
    write_sheet(file, images, rows=rows, columns=_names(levels), title="Ablation", height=height)


def _names(levels: Sequence[float]) -> list[str]:
    return [f"γ = {level:g}" for level in levels]


def error_map(image: Image | None, truth: Image | None) -> Image | None:
    """Mean absolute difference of the channels, black to yellow; None where either is missing."""
    if image is None or truth is None:
        return None
    from matplotlib import colormaps

    error = np.abs(image - truth).mean(axis=2) / ERROR_SCALE
    return colormaps["inferno"](np.clip(error, 0, 1))[:, :, :3]
