"""The tidy rows of a benchmark, and their CSV file."""

from __future__ import annotations

import csv
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from statistics import median
from typing import NamedTuple

from carigs.files import writing


class Measurement(NamedTuple):
    """One number; `reference` is what it is compared with in the same run, None if with nothing."""

    case: str
    quantity: str
    unit: str
    value: float
    reference: float | None = None


def write_measurements(file: Path, measurements: Iterable[Measurement]) -> None:
    """Write rows as CSV; numbers keep six significant digits."""
    with writing(file) as part, part.open("w", newline="", encoding="utf-8") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(Measurement._fields)
        for m in measurements:
            reference = "" if m.reference is None else f"{m.reference:.6g}"
            writer.writerow([m.case, m.quantity, m.unit, f"{m.value:.6g}", reference])


def seconds(work: Callable[[], object], repeats: int = 5) -> float:
    """Median wall time of `work`, called once more before to warm up."""
    work()
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return median(times)
