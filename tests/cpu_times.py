"""A plugin of pytest: the CPU seconds of each test, with its processes, and of collection.

    CPU_TIMES=times.csv pytest -p cpu_times ...       a line `seconds, test` for each, of all workers
    python tests/cpu_times.py times.csv ...           a table: seconds of each folder of `tests`, a column for each file

CPU time says what a test costs also where the machine has other work.
"""

from __future__ import annotations

import csv
import os
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil
import pytest


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
    me, seconds = psutil.Process(), 0.0
    for process in (me, *me.children()):
        with suppress(psutil.NoSuchProcess):
            seconds += sum(process.cpu_times()[:4])
    return seconds


def _seconds_by_room(file: str) -> Counter:
    found = Counter()
    with open(file, newline="") as stream:
        for seconds, name in csv.reader(stream):
            path = Path(name.partition("::")[0])
            room = f"{path.parts[1]}/" if len(path.parts) > 2 else "files of `tests`" if len(path.parts) == 2 else name
            found[room] += float(seconds)
    return found


def main() -> None:
    """Print the table."""
    columns = [_seconds_by_room(file) for file in sys.argv[1:]]
    print(f"| room | {' | '.join(Path(file).stem for file in sys.argv[1:])} |\n|---|{'---:|' * len(columns)}")
    for room, _ in sum(columns, Counter()).most_common():
        print(f"| {room} | {' | '.join(f'{column[room]:.0f}' for column in columns)} |")
    print(f"| all | {' | '.join(f'{column.total():.0f}' for column in columns)} |")


if __name__ == "__main__":
    main()
