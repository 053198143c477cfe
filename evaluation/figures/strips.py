"""Image figures: one variant over the levels beside the truth, and all variants beside each other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from evaluation.figures.sheet import Image, write_sheet

ERROR_SCALE = 0.25
"""Absolute error (mean of the channels) of the brightest colour."""


def gamma_strip(
    file: Path,
    variant: str,
    levels: Sequence[float],
    renders: Sequence[Image | None],
    truths: Sequence[Image | None],
    *,
    height: int,
) -> None:
    """Draw one variant's renders at each level, the true images, and their difference where there is a truth.

    Args:
        file: PNG file to write.
        variant: Name of the variant.
        levels: Rendered levels.
        renders: Image at each level.
        truths: True image at each level.
        height: Height of each image in pixels.
    """
    labels, images, footnote = [variant], [renders], ""
    if any(truth is not None for truth in truths):
        labels += ["truth", "error"]
        images += [truths, [error_map(*pair) for pair in zip(renders, truths, strict=True)]]
        footnote = f"error: mean absolute difference of the channels, black 0 to yellow {ERROR_SCALE:g} or more"
    columns = _level_labels(levels)
    write_sheet(file, images, rows=labels, columns=columns, title=variant, height=height, footnote=footnote)


def ablation(
    file: Path,
    renders: dict[str, Sequence[Image | None]],
    levels: Sequence[float],
    truths: Sequence[Image | None],
    *,
    height: int,
) -> None:
    """Draw every variant's renders (rows) at each level (columns), above the true images.

    Args:
        file: PNG file to write.
        renders: Images of each variant, one per level.
        levels: Rendered levels.
        truths: True image at each level.
        height: Height of each image in pixels.
    """
    labels, images = list(renders), list(renders.values())
    if any(truth is not None for truth in truths):
        labels, images = [*labels, "truth"], [*images, truths]
    write_sheet(file, images, rows=labels, columns=_level_labels(levels), title="Ablation", height=height)


def _level_labels(levels: Sequence[float]) -> list[str]:
    return [f"γ = {level:g}" for level in levels]


def error_map(image: Image | None, truth: Image | None) -> Image | None:
    """Mean absolute difference of the channels in colours, black to yellow.

    Args:
        image: Image.
        truth: True image.

    Returns:
        The colours; None if either image is missing.
    """
    if image is None or truth is None:
        return None
    from matplotlib import colormaps

    error = np.abs(image - truth).mean(axis=2) / ERROR_SCALE
    return colormaps["inferno"](np.clip(error, 0, 1))[:, :, :3]
