"""Progress of a long loop on stderr: a live bar on a terminal, a line every ten seconds elsewhere."""

from __future__ import annotations

import sys
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager

WARM_UP_SECONDS = 2.0
"""Before the rate is measured, because the first steps compile kernels and fill caches; and for which it is measured
before it is shown."""
SPACING_SECONDS = 0.25
"""Between the steps whose times are kept."""


class RecentRate:
    """Steps per second over the later half of a loop so far.

    Steps become faster when all images are decoded and another process has compiled the last kernels, and slower when
    there are more surfels. The rate over the whole loop follows such changes too late for the time that is left.
    """

    def __init__(self) -> None:
        self._started: float | None = None
        self._warm: float | None = None  # the first step after the warm-up: a first step may take a minute
        self._kept: deque[tuple[float, int]] = deque()  # times and steps, the first at or before the middle

    def add(self, clock: float, step: int) -> float | None:
        """Note a step.

        Args:
            clock: Time in seconds.
            step: Number of steps done.

        Returns:
            Steps per second, or None in the first seconds.
        """
        if self._started is None:
            self._started = clock
        if clock - self._started < WARM_UP_SECONDS:
            return None
        if self._warm is None:
            self._warm = clock
        if not self._kept or clock - self._kept[-1][0] >= SPACING_SECONDS:
            self._kept.append((clock, step))
        while len(self._kept) > 2 and self._kept[1][0] <= (self._warm + clock) / 2:
            self._kept.popleft()
        if clock - self._warm < WARM_UP_SECONDS:
            return None
        at, first = self._kept[0]
        return (step - first) / (clock - at)


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
    last = time.perf_counter()
    recent = RecentRate()
    recent.add(last, done)

    def text(now: int, figures: dict[str, float]) -> str:
        rate = recent.add(time.perf_counter(), now)
        parts = [f"{key} {value:.6g}" for key, value in figures.items()]
        if rate:
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
