"""A labelled sheet of images: the layout that strips and ablations share."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float

from carigs.files import writing

Image = Float[np.ndarray, "_ _ 3"]
DPI = 100
MARGIN, LABEL, TITLE = 0.08, 0.3, 0.4  # inches


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
) -> None:
    """Write a PNG with `images` (rows x columns, values in [0, 1]), each `height` pixels high; None stays blank.

    `legend` says below the images what colours stand for.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    first = next(image for line in images for image in line if image is not None)
    cell_height = height / DPI
    cell_width = cell_height * first.shape[1] / first.shape[0]
    width = LABEL + len(columns) * cell_width + 2 * MARGIN
    below = LABEL if footnote or legend else 0.0
    total = TITLE + LABEL + len(rows) * cell_height + MARGIN + below
    figure = Figure(figsize=(width, total), dpi=DPI, facecolor="white")
    FigureCanvasAgg(figure)
    figure.text(0.5, 1 - 0.5 * TITLE / total, title, ha="center", va="center", fontsize=12)
    if footnote:
        figure.text(0.5, 0.5 * below / total, footnote, ha="center", va="center", fontsize=8)
    if legend:
        patches = [Patch(color=colour, label=name) for name, colour in legend.items()]
        place = (0.5, 0.5 * below / total)
        figure.legend(
            handles=patches, loc="center", bbox_to_anchor=place, ncols=len(patches), fontsize=7, frameon=False,
            handlelength=1, columnspacing=1.2,
        )  # fmt: skip
    for i, line in enumerate(images):
        bottom = total - TITLE - LABEL - (i + 1) * cell_height
        middle = (bottom + 0.5 * cell_height) / total
        figure.text((MARGIN + 0.5 * LABEL) / width, middle, rows[i], rotation=90, ha="center", va="center", fontsize=10)
        for j, image in enumerate(line):
            left = MARGIN + LABEL + j * cell_width
            if i == 0:
                middle = (total - TITLE - 0.5 * LABEL) / total
                figure.text(
                    (left + 0.5 * cell_width) / width, middle, columns[j], ha="center", va="center", fontsize=10
                )
            axes = figure.add_axes([left / width, bottom / total, cell_width / width, cell_height / total])
            axes.set_axis_off()
            if image is None:
                axes.text(0.5, 0.5, "no image", ha="center", va="center", fontsize=9, color="grey")
            else:
                axes.imshow(_resized(image, round(cell_width * DPI), height), interpolation="nearest")
    with writing(file) as part:
        figure.savefig(part, metadata={"Software": None})


def _resized(image: Image, width: int, height: int) -> Image:
    shrinks = image.shape[0] > height
    method = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.clip(cv2.resize(np.asarray(image, np.float32), (width, height), interpolation=method), 0, 1)
