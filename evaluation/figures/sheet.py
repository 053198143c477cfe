"""A sheet of images with row and column labels: the layout of all figures that show images."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from textwrap import wrap
from typing import Any

import cv2
import numpy as np
from jaxtyping import Float

from evaluation.figures.png_figure import png_figure
from evaluation.figures.style import LARGE, MEDIUM, SMALL, TEXT_WIDTH

Image = Float[np.ndarray, "_ _ 3"]
MIN_DPI = 150
"""Pixels per inch of a sheet that is narrower than the text of a paper; wider ones have more, and that width."""
MARGIN, LABEL, TITLE = 0.05, 0.2, 0.3  # inches
LEGEND_ENTRY, LEGEND_LINE = 1.1, 0.16
"""Width of the widest entry and height of a line of the legend in inches."""
CHARACTER = 0.55
"""Mean width of a character over the size of its font."""


def write_sheet(
    file: Path,
    images: Sequence[Sequence[Image | None]],
    *,
    rows: Sequence[str],
    columns: Sequence[str],
    title: str,
    height: int,
    footnote: str = "",
    legend: Mapping[str, tuple[float, float, float]] | None = None,
    captions: Sequence[Sequence[str]] | None = None,
) -> None:
    """Write a sheet of images as PNG.

    Args:
        file: PNG file to write.
        images: Rows of images with values in [0, 1]; None leaves a cell blank.
        rows: Labels of the rows.
        columns: Labels of the columns.
        title: Title above the sheet.
        height: Height of each image in pixels.
        footnote: Text below the images, in as many lines as it takes.
        legend: Colours and their meaning, below the images.
        captions: Text in the lower left corner of each image.
    """
    from matplotlib.patches import Patch

    first = next(image for line in images for image in line if image is not None)
    pixels = height * first.shape[1] / first.shape[0]
    cell_width = min(pixels / MIN_DPI, (TEXT_WIDTH - LABEL - 2 * MARGIN) / len(columns))
    dpi = pixels / cell_width
    cell_height = height / dpi
    width = LABEL + len(columns) * cell_width + 2 * MARGIN
    entries = max(int(width / LEGEND_ENTRY), 1)  # in a line of the legend
    note = wrap(footnote, max(int(72 * (width - 2 * MARGIN) / (CHARACTER * SMALL)), 1))
    lines = max(-(-len(legend or ()) // entries), len(note))
    below = LABEL + LEGEND_LINE * max(lines - 1, 0) if footnote or legend else 0.0
    total = TITLE + LABEL + len(rows) * cell_height + MARGIN + below
    with png_figure(file, (width, total), dpi=dpi, facecolor="white") as figure:
        # One pair of axes in inches from the lower left corner: axes for each image take longer than the images.
        axes = figure.add_axes((0, 0, 1, 1), xlim=(0, width), ylim=(0, total), autoscale_on=False)
        axes.set_axis_off()

        def text(x: float, y: float, label: str, size: int, **options: Any) -> None:
            axes.text(x, y, label, **{"ha": "center", "va": "center", "fontsize": size, **options})

        text(0.5 * width, total - 0.5 * TITLE, title, LARGE)
        if footnote:
            text(0.5 * width, 0.5 * below, "\n".join(note), SMALL)
        if legend:
            patches = [Patch(color=colour, label=name) for name, colour in legend.items()]
            figure.legend(
                handles=patches, loc="center", bbox_to_anchor=(0.5, 0.5 * below / total), ncols=entries,
                fontsize=SMALL, frameon=False, handlelength=1, columnspacing=1.2,
            )  # fmt: skip
        for i, line in enumerate(images):
            bottom = total - TITLE - LABEL - (i + 1) * cell_height
            text(MARGIN + 0.5 * LABEL, bottom + 0.5 * cell_height, rows[i], MEDIUM, rotation=90)
            for j, image in enumerate(line):
                left = MARGIN + LABEL + j * cell_width
                if i == 0:
                    text(left + 0.5 * cell_width, total - TITLE - 0.5 * LABEL, columns[j], MEDIUM)
                if image is None:
                    text(left + 0.5 * cell_width, bottom + 0.5 * cell_height, "no image", SMALL, color="grey")
                else:
                    extent = (left, left + cell_width, bottom, bottom + cell_height)
                    shown = _resized(image, round(pixels), height)
                    axes.imshow(shown, interpolation="nearest", extent=extent, aspect="auto")
                if captions and captions[i][j]:
                    box = {"facecolor": "white", "alpha": 0.8, "edgecolor": "none", "pad": 1}
                    place = left + 0.02 * cell_width, bottom + 0.02 * cell_height
                    text(*place, captions[i][j], SMALL, ha="left", va="baseline", bbox=box)


def _resized(image: Image, width: int, height: int) -> Image:
    method = cv2.INTER_AREA if image.shape[0] > height else cv2.INTER_LINEAR
    return np.clip(cv2.resize(np.asarray(image, np.float32), (width, height), interpolation=method), 0, 1)
