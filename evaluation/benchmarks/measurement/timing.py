"""Timing of functions, in turns with the functions that they are compared with, and the record of a measurement."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from statistics import median
from typing import NamedTuple

from evaluation.tables.csv_files import stream_csv

# With one thread the calling thread does all the work: its CPU time excludes other work on the machine.
cpu_seconds = time.thread_time
wall_seconds = time.perf_counter


class Measurement(NamedTuple):
    """One measured number of a benchmark."""

    case: str
    quantity: str
    unit: str
    value: float
    reference: float | None = None
    """Number that `value` is compared with, from the same run; None if there is none."""


def write_measurements(file: Path, measurements: Iterable[Measurement]) -> list[Measurement]:
    """Write measurements to a CSV file as they are taken, and print each.

    Args:
        file: CSV file to write.
        measurements: Records.

    Returns:
        The records.
    """

    def printed() -> Iterator[Measurement]:
        for m in measurements:
            print(f"{m.case}: {m.quantity} {m.value:.4g} {m.unit}", flush=True)
            yield m

    return stream_csv(file, printed(), Measurement)


def elapsed(work: Callable[[], object], clock: Callable[[], float]) -> float:
    """Time one call.

    Args:
        work: Function to call.
        clock: Function that returns seconds.

    Returns:
        Seconds.
    """
    start = clock()
    work()
    return clock() - start


def median_time(work: Callable[[], object], repeats: int = 5, clock: Callable[[], float] = wall_seconds) -> float:
    """Median time of repeated calls, after a first one to warm up.

    Args:
        work: Function to call.
        repeats: Number of timed calls.
        clock: Function that returns seconds.

    Returns:
        Seconds.
    """
    return compare_times({"": work}, repeats, clock)[""]


def median_times_in_turns(
    works: Mapping[str, Callable[[], Mapping[str, float]]], repeats: int
) -> dict[str, dict[str, float]]:
    """Medians of times that several functions report, called in turns, after a first round to warm up.

    Args:
        works: Functions that time themselves: each returns seconds by name.
        repeats: Number of rounds.

    Returns:
        Median of every time, by function and name.
    """
    rounds = [{key: work() for key, work in works.items()} for _ in range(repeats + 1)][1:]
    return {key: {name: median(r[key][name] for r in rounds) for name in rounds[0][key]} for key in works}


def compare_times(
    works: Mapping[str, Callable[[], object]], repeats: int, clock: Callable[[], float] = wall_seconds
) -> dict[str, float]:
    """Median times of several functions, called in turns.

    Args:
        works: Functions by name.
        repeats: Number of rounds, after a first one to warm up.
        clock: Function that returns seconds.

    Returns:
        Seconds by name.
    """
    timed = {name: lambda work=work: {"": elapsed(work, clock)} for name, work in works.items()}
    return {name: times[""] for name, times in median_times_in_turns(timed, repeats).items()}


def run_in_fresh_process(code: str, **environment: str) -> dict[str, float]:
    """Run Python code that prints times as JSON on its last line.

    Args:
        code: The code.
        environment: Environment variables to set.

    Returns:
        Seconds by name.
    """
    completed = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **environment}, check=True, capture_output=True, text=True
    )
    return json.loads(completed.stdout.splitlines()[-1])
