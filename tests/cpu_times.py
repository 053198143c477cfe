"""A plugin of pytest: the CPU seconds of each test, with its processes, and of collection.

    CPU_TIMES=times.csv pytest -p cpu_times ...       a line `seconds, test` for each, of all workers
    python tests/cpu_times.py times.csv ...           tables: tests and seconds of each folder of `tests`, with columns
                                                      for each file, and the dearest tests of each file

CPU time says what a test costs also where the machine has other work.
"""

from __future__ import annotations

import csv
import os
import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import psutil
import pytest

DEAREST = 10
"""Tests of each file that are listed."""


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Iterator[None]:
    """Measure a test, and the fixtures that are made for it first."""
    return (yield from _measured(item.nodeid))


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Measure the imports."""
    return (yield from _measured("collection"))


def _measured(name: str) -> Iterator[None]:
    before = _spent()
    result = yield
    with open(os.environ["CPU_TIMES"], "a", newline="") as stream:
        csv.writer(stream).writerow([f"{_spent() - before:.2f}", name])
    return result


def _spent() -> float:
    """Seconds of this process, of those that it has waited for, and of its servers."""
    seconds = sum(os.times()[:4])
    for process in _children():
        with suppress(psutil.NoSuchProcess):
            seconds += sum(psutil.Process(process).cpu_times()[:4])
    return seconds


def _children() -> Iterable[int]:
    """Where the kernel lists them, not by a search among all processes: that would cost more than most tests."""
    lists = [*Path("/proc/self/task").glob("*/children")]
    if not lists:
        return [child.pid for child in psutil.Process().children()]
    found = []
    for file in lists:
        with suppress(OSError):  # a thread that has ended
            found += map(int, file.read_text().split())
    return found


def _read(file: str) -> Iterator[tuple[float, str]]:
    with open(file, newline="") as stream:
        yield from ((float(seconds), name) for seconds, name in csv.reader(stream))


def _room(name: str) -> str:
    parts = Path(name.partition("::")[0]).parts
    return f"{parts[1]}/" if len(parts) > 2 else "files of `tests`" if len(parts) == 2 else name


def _by_room(file: str) -> tuple[Counter, Counter]:
    """Numbers of tests, and seconds."""
    tests, seconds = Counter(), Counter()
    for spent, name in _read(file):
        tests[_room(name)] += "::" in name
        seconds[_room(name)] += spent
    return tests, seconds


def _print_table(heads: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
    print(f"| {' | '.join(heads)} |\n|{'---|' + '---:|' * (len(heads) - 1)}")
    for row in rows:
        print(f"| {' | '.join(row)} |")
    print()


def main() -> None:
    """Print the tables."""
    files = sys.argv[1:]
    found = {Path(file).stem: _by_room(file) for file in files}
    columns = [column for pair in found.values() for column in pair]
    heads = [head for stem in found for head in (f"{stem}: tests", f"{stem}: CPU s")]
    order = sum((seconds for _, seconds in found.values()), Counter()).most_common()
    rows = [[room, *(f"{column[room]:.0f}" for column in columns)] for room, _ in order]
    _print_table(["room", *heads], [*rows, ["all", *(f"{column.total():.0f}" for column in columns)]])
    for file in files:
        dearest = sorted((row for row in _read(file) if "::" in row[1]), reverse=True)[:DEAREST]
        _print_table([Path(file).stem, "CPU s"], [[f"`{name}`", f"{seconds:.1f}"] for seconds, name in dearest])


if __name__ == "__main__":
    main()
