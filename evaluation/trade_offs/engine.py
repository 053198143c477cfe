"""The surfel engine beside plain loops and PyTorch, from the records of `evaluation.benchmarks.splat`."""

from __future__ import annotations

from collections.abc import Iterator

import pandas as pd

from evaluation.tables.document import Cell, Document, Table, to_markdown

HIGHER_IS_BETTER = "1/s"
TIMES = ("ms", HIGHER_IS_BETTER)
IN_PYTORCH = "L1 + SSIM"
"""The quantity whose reference is PyTorch; the others' is the backend `scalar`, plain loops in Numba."""
UNITS = {"ms": "ms", "1/s": "per second", "s": "s"}


def describe_engine(table: pd.DataFrame) -> Iterator[str]:
    """Describe the times of the engine, the ratios first.

    Args:
        table: Records of the benchmark `splat`.

    Yields:
        Paragraphs of Markdown.
    """
    yield "## Surfel engine\n"
    yield "`python -m evaluation.benchmarks.splat`: surfels on an ellipsoid that covers half of the image, in random"
    yield "order; in the scene `dense` discs are twice as large; `geometry` renders depth and normals, too, and"
    yield "`distortion` these and the distortion."
    yield "`all kernels` is the sum of the kernels; `with torch around them` is a call through PyTorch's autograd."
    yield "Medians of turns in one process: the vector kernels (`train.backend=cpu`), and the plain loops of the"
    yield "backend `scalar`, or for L1 + SSIM PyTorch. The ratio says how many times as fast the first are; higher is"
    yield "better. Kernels, skinning and colours have CPU times of one thread; `forward and backward`, renderings,"
    yield "training steps and L1 + SSIM have times on the clock.\n"
    compared = table[table.unit.isin(TIMES) & table.reference.notna()]
    lines = [
        (
            f"{row.case}: {row.quantity}",
            [
                Cell(f"{ratio(row.unit, row.value, row.reference):.1f}"),
                Cell(f"{row.value:.3g} {UNITS[row.unit]}"),
                Cell(f"{row.reference:.3g} {UNITS[row.unit]}"),
                Cell("PyTorch" if row.quantity == IN_PYTORCH else "plain loops"),
            ],
        )
        for row in compared.itertuples()
    ]
    header = ["ratio ↑", "carigs", "the other", "which is"]
    yield to_markdown(Document(tables=[Table("Times as fast", header, [("", lines)])]))
    alone = table[table.unit.isin(UNITS) & table.reference.isna()]
    lines = [
        (f"{row.case}: {row.quantity}", [Cell(f"{row.value:.3g} {UNITS[row.unit]}")]) for row in alone.itertuples()
    ]
    if lines:
        yield to_markdown(Document(tables=[Table("Without a comparison", ["value"], [("", lines)])]))


def ratio(unit: str, value: float, reference: float) -> float:
    """How many times as fast the first of two measurements is.

    Args:
        unit: Unit of both: a time, or a rate (`1/s`).
        value: The first.
        reference: The second.

    Returns:
        The ratio; above 1 if the first is faster.
    """
    return value / reference if unit == HIGHER_IS_BETTER else reference / value
