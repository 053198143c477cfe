"""Means over frames with bootstrap intervals, and paired differences against the reference variant."""

from __future__ import annotations

import csv
import math
from collections import defaultdict
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

import numpy as np

from carigs.errors import CarigsError
from carigs.files import writing
from carigs.settings import Tabulate
from evaluation.metrics.regions import REGIONS
from evaluation.tables.bootstrap import Interval, mean_interval
from evaluation.tables.rows import Row


class Summary(NamedTuple):
    """One line of the table: a mean, or the mean of paired differences where `minus` is set."""

    study: str
    gamma: float
    level: float
    protocol: str
    region: str
    metric: str
    variant: str
    minus: str
    """The variant that was subtracted frame by frame; empty for a plain mean."""
    mean: float | None
    low: float | None
    high: float | None
    n: int
    """Frames with a value."""
    nulls: int
    """Rows without one."""
    reason: str


_Frame = tuple[str, int | None, int | None]  # subject, timestep, camera


def summarise(rows: Iterable[Row], settings: Tabulate) -> list[Summary]:
    """Summaries of every variant x gamma x level x protocol x region x metric, and the reference minus each other one.

    Subjects, timesteps and cameras are resampled.  Raises `CarigsError` if two rows measure the same thing.
    """
    values: dict[tuple, dict[_Frame, float]] = defaultdict(dict)
    nulls: dict[tuple, list[str]] = defaultdict(list)
    for row in rows:
        key = (row.study, row.gamma, row.level, row.protocol, row.region, row.metric, row.variant)
        if row.value is None:
            nulls[key].append(row.reason)
            continue
        frame = (row.subject, row.timestep, row.camera)
        if frame in values[key]:
            place = f"subject {row.subject}, timestep {row.timestep}, camera {row.camera}"
            raise CarigsError(
                f"{row.variant}, level {row.level:g}: {row.metric} of {row.region} is given twice for {place}"
            )
        values[key][frame] = row.value
    summaries = []
    for key in values.keys() | nulls.keys():
        here, reasons = values.get(key, {}), nulls.get(key, [])
        reason = "; ".join(sorted(set(reasons)))
        summaries.append(Summary(*key, "", *_mean(here, settings), len(here), len(reasons), reason))
        if key[-1] != settings.reference and (reference := values.get((*key[:-1], settings.reference))):
            pairs = {frame: reference[frame] - here[frame] for frame in reference.keys() & here.keys()}
            if pairs:
                line = (*key[:-1], settings.reference, key[-1], *_mean(pairs, settings), len(pairs), 0, "")
                summaries.append(Summary(*line))
    return sorted(summaries, key=_position)


def write_csv(file: Path, summaries: Iterable[Summary]) -> None:
    """All summaries; numbers with six significant digits, empty where there is none."""
    with writing(file) as part, part.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(Summary._fields)
        for summary in summaries:
            writer.writerow([_cell(value) for value in summary])


def _mean(frames: dict[_Frame, float], settings: Tabulate) -> tuple[float | None, ...]:
    if not frames:
        return None, None, None
    subjects, timesteps, cameras = zip(*((s, (s, -1 if t is None else t), c) for s, t, c in frames), strict=True)
    found: Interval = mean_interval(
        np.array(list(frames.values())),
        [subjects, timesteps, [-1 if camera is None else camera for camera in cameras]],
        resamples=settings.resamples,
        confidence=settings.confidence,
        seed=settings.seed,
    )
    return tuple(value if math.isfinite(value) else None for value in found)


def _position(summary: Summary) -> tuple:
    region = REGIONS.index(summary.region) if summary.region in REGIONS else len(REGIONS)
    return (*summary[:4], region, *summary[4:8])


def _cell(value: object) -> object:
    return "" if value is None else f"{value:.6g}" if isinstance(value, float) else value
