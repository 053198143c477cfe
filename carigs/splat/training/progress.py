"""How far a run is: a live line on a terminal, a line every ten seconds elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Protocol


class Report(Protocol):
    """Called after every step."""

    def __call__(self, done: int, **figures: float) -> None:
        """`done` steps of the total are finished; `figures` are shown by name."""


@contextmanager
def progress(name: str, total: int, done: int = 0, every_seconds: float = 10.0) -> Iterator[Report]:
    """Show rate, time left and the figures of a loop of `total` steps, of which `done` were done before."""
    if not sys.stderr.isatty():
        yield _lines(name, total, done, every_seconds)
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = [
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[figures]}"),
    ]
    with Progress(*columns, TimeRemainingColumn(), console=Console(stderr=True)) as bars:
        task = bars.add_task(name, total=total, completed=done, figures="")
        started = time.perf_counter()

        def report(now: int, **figures: float) -> None:
            rate = (now - done) / max(time.perf_counter() - started, 1e-9)
            bars.update(task, completed=now, figures=_figures(rate, figures))

        yield report


def _figures(rate: float, figures: dict[str, float]) -> str:
    return "  ".join([f"{rate:.1f} it/s", *(f"{name} {value:.6g}" for name, value in figures.items())])


def _lines(name: str, total: int, done: int, every_seconds: float) -> Report:
    started = last = time.perf_counter()

    def report(now: int, **figures: float) -> None:
        nonlocal last
        clock = time.perf_counter()
        if clock - last < every_seconds and now < total:
            return
        last = clock
        rate = (now - done) / max(clock - started, 1e-9)
        left = (total - now) / max(rate, 1e-9)
        print(f"{name} {now}/{total}  {_figures(rate, figures)}  {left:.0f} s left", file=sys.stderr, flush=True)

    return report
