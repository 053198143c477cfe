"""PSNR of training frames against the time of training, as lines of an SVG."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from carigs.capture.evenly_spread import evenly_spread
from carigs.errors import InputError
from carigs.readers.limits import MAX_TEXT_BYTES, read_bytes
from carigs.readers.text import decode_text

MEAN_OF = 5
"""Lines of the log that are averaged: each is one frame of another view."""
MAX_POINTS = 150
"""Most points of a line."""
WIDTH, HEIGHT = 640, 320
"""Size of the SVG's coordinates."""
LEFT, RIGHT, TOP, BOTTOM = 56, 12, 12, 44
"""Margins for the axes."""
KINDS = {"0": "real frames", "1": "GT* frames"}
"""Supervision by the column `caricature` of the log."""


class ChartLine(NamedTuple):
    """PSNR of one variant and kind of frames."""

    name: str
    kind: int
    """0 for real frames, 1 for GT* frames."""
    colour: int
    """Number of the variant."""
    seconds: Float[np.ndarray, " n"]
    psnr: Float[np.ndarray, " n"]


class Tick(NamedTuple):
    """A mark of an axis."""

    place: float
    label: str


class Chart(NamedTuple):
    """Lines with axes in the coordinates of the SVG."""

    lines: list[tuple[ChartLine, str]]
    """Lines with their points as SVG has them."""
    across: list[Tick]
    up: list[Tick]
    description: str
    """What the lines show, for readers who do not see them."""


def training_lines(log: Path, variant: str, colour: int) -> list[ChartLine]:
    """Read the PSNR of a training.

    Args:
        log: The training's log.csv, with the columns seconds, caricature and psnr.
        variant: Name of the variant.
        colour: Its number.

    Returns:
        A line for real frames and one for GT* frames, if there are such; moving means over `MEAN_OF` entries.

    Raises:
        InputError: The log is malformed.
    """
    text = io.StringIO(decode_text(read_bytes(log, MAX_TEXT_BYTES, "training log"), log), newline="")
    points: dict[str, list[tuple[float, float]]] = {}
    try:
        for row in csv.DictReader(text):
            points.setdefault(row["caricature"], []).append((float(row["seconds"]), float(row["psnr"])))
    except (KeyError, TypeError, ValueError, csv.Error) as error:
        problem = f"expected numbers in the columns seconds, caricature and psnr ({error})"
        raise InputError(problem, file=log) from error
    lines = []
    for caricature, name in KINDS.items():
        seconds, psnr = np.array(points.get(caricature, []), float).reshape(-1, 2).T
        inside = np.isfinite(seconds) & np.isfinite(psnr)
        seconds, psnr = moving_mean(seconds[inside]), moving_mean(psnr[inside])
        if len(psnr):
            chosen = evenly_spread(range(len(psnr)), MAX_POINTS)
            lines.append(ChartLine(f"{variant}, {name}", int(caricature), colour, seconds[chosen], psnr[chosen]))
    return lines


def moving_mean(values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " m"]:
    """Means of `MEAN_OF` values that follow each other.

    Args:
        values: Values.

    Returns:
        One mean per place; of all values, where there are fewer.
    """
    count = min(MEAN_OF, len(values))
    return np.convolve(values, np.full(count, 1 / count), "valid") if count else values


def training_chart(lines: Sequence[ChartLine]) -> Chart | None:
    """Place lines in a chart.

    Args:
        lines: The lines.

    Returns:
        The chart; None without a line.
    """
    if not lines:
        return None
    seconds, psnr = (np.concatenate([getattr(line, name) for line in lines]) for name in ("seconds", "psnr"))
    across, up = _axis(0.0, seconds.max(), LEFT, WIDTH - RIGHT), _axis(psnr.min(), psnr.max(), HEIGHT - BOTTOM, TOP)
    placed = [(line, _points(across.place(line.seconds), up.place(line.psnr))) for line in lines]
    ends = "; ".join(f"{line.name}: {line.psnr[-1]:.1f} dB after {line.seconds[-1]:.0f} s" for line in lines)
    return Chart(placed, across.ticks, up.ticks, f"PSNR of the training frames against seconds. At the end: {ends}.")


class _Axis(NamedTuple):
    low: float
    scale: float
    origin: float
    ticks: list[Tick]

    def place(self, values: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
        return self.origin + (values - self.low) * self.scale


def _axis(low: float, high: float, first: float, last: float) -> _Axis:
    """An axis with about five round ticks from one place of the SVG to another."""
    span = max(high - low, 1e-6)
    power = 10.0 ** np.floor(np.log10(span / 5))
    step = power * next(factor for factor in (1, 2, 5, 10) if power * factor >= span / 6)
    low, high = np.floor(low / step) * step, np.ceil((low + span) / step) * step
    scale = (last - first) / (high - low)
    values = np.arange(low, high + step / 2, step)
    return _Axis(low, scale, first, [Tick(round(first + (v - low) * scale, 1), f"{v:g}") for v in values.round(6)])


def _points(x: Float[np.ndarray, " n"], y: Float[np.ndarray, " n"]) -> str:
    return " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True))


def subject_chart(logs: Mapping[str, Path]) -> Chart | None:
    """The chart of the trainings of one subject.

    Args:
        logs: The log.csv of each variant.

    Returns:
        The chart; None if no log has an entry.

    Raises:
        InputError: A log is malformed.
    """
    variants = enumerate(logs.items())
    return training_chart([line for i, (name, log) in variants for line in training_lines(log, name, i)])
