"""The tidy rows of a benchmark, and their CSV file."""

from __future__ import annotations

import csv
import os
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from statistics import median
from typing import NamedTuple


class Measurement(NamedTuple):
    """One number; `reference` is what it is compared with in the same run, None if with nothing."""

    case: str
    quantity: str
    unit: str
    value: float
    reference: float | None = None


def write_measurements(file: Path, measurements: Iterable[Measurement]) -> list[Measurement]:
    """Write rows as CSV while they come, and return them; numbers keep six significant digits.

    Until all are there they are in `.NAME.part.csv`, where a run that is killed leaves what it measured.
    """
    rows, part = [], file.with_name(f".{file.stem}.part{file.suffix}")
    file.parent.mkdir(parents=True, exist_ok=True)
    with part.open("w", newline="", encoding="utf-8", buffering=1) as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(Measurement._fields)
        for m in measurements:
            reference = "" if m.reference is None else f"{m.reference:.6g}"
            writer.writerow([m.case, m.quantity, m.unit, f"{m.value:.6g}", reference])
            rows.append(m)
    os.replace(part, file)
    return rows


def seconds(
    work: Callable[[], object], repeats: int = 5, clock: Callable[[], float] = time.perf_counter, warm: bool = True
) -> float:
    """Median time of `work`, wall time unless the clock is another, called once more before to warm up."""
    if warm:
        work()
    times = []
    for _ in range(repeats):
        start = clock()
        work()
        times.append(clock() - start)
    return median(times)
