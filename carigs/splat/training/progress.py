"""Progress of a long loop on stderr: a live bar on a terminal, a line every ten seconds elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

WARM_UP_SECONDS = 2.0
"""Before the rate is measured, because the first steps compile kernels and fill caches; and for which it is measured
before it is shown."""


@contextmanager
def progress(name: str, total: int, done: int = 0, every_seconds: float = 10.0) -> Iterator[Callable[..., None]]:
    """Show steps, rate, time left and figures of a loop.

    Args:
        name: Name of the loop.
        total: Number of steps.
        done: Steps that were done before.
        every_seconds: Interval of the lines where stderr is no terminal.

    Yields:
        Function to call after every step with the number of steps done, and with their total if it has become another
        one; figures to show are keywords.

    Example:
        >>> with progress("train", 100) as report:
        ...     report(1, loss=0.5)
    """
    started = last = time.perf_counter()
    warm: tuple[float, int] | None = None  # time and step from which the rate is measured

    def text(now: int, figures: dict[str, float]) -> str:
        nonlocal warm
        clock = time.perf_counter()
        if warm is None and clock - started >= WARM_UP_SECONDS:
            warm = clock, now
        parts = [f"{key} {value:.6g}" for key, value in figures.items()]
        if warm and clock - warm[0] >= WARM_UP_SECONDS:
            rate = (now - warm[1]) / (clock - warm[0])
            parts = [f"{rate:.1f} it/s", *parts, *([f"{(total - now) / rate:.0f} s left"] if now < total else [])]
        return "  ".join(parts)

    def report_line(now: int, new_total: int = total, **figures: float) -> None:
        nonlocal last, total
        total = new_total
        shown, clock = text(now, figures), time.perf_counter()
        if clock - last >= every_seconds or now >= total:
            last = clock
            print(f"{name} {now}/{total}  {shown}".rstrip(), file=sys.stderr, flush=True)

    if not sys.stderr.isatty():
        yield report_line
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (TextColumn(name), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[text]}"))
    with Progress(*columns, console=Console(stderr=True)) as bars:
        task = bars.add_task(name, total=total, completed=done, text="")

        def report_bar(now: int, new_total: int = total, **figures: float) -> None:
            nonlocal total
            total = new_total
            bars.update(task, completed=now, total=total, text=text(now, figures))

        yield report_bar
