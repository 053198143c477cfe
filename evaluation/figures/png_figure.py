"""Matplotlib figures as PNG files, without a display."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from carigs.files import writing


@contextmanager
def png_figure(file: Path, size: tuple[float, float], *, dpi: int = 120, **options: Any) -> Iterator[Any]:
    """Create a figure, and write it when the block ends.

    Args:
        file: PNG file to write. Equal contents give equal bytes.
        size: Width and height in inches.
        dpi: Pixels per inch.
        options: Further arguments of `matplotlib.figure.Figure`; the default is a constrained layout.

    Yields:
        The `matplotlib.figure.Figure`.
    """
    # Imported here: stages that draw nothing would wait for it.
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=size, dpi=dpi, **(options or {"layout": "constrained"}))
    FigureCanvasAgg(figure)
    yield figure
    with writing(file) as part:
        figure.savefig(part, metadata={"Software": None})
