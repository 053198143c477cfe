"""Progress of a long loop on stderr: a live bar on a terminal, a line every ten seconds elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def progress(name: str, total: int, done: int = 0, every_seconds: float = 10.0) -> Iterator[Callable[..., None]]:
    """Show steps, rate, time left and figures of a loop.

    Args:
        name: Name of the loop.
        total: Number of steps.
        done: Steps that were done before.
        every_seconds: Interval of the lines where stderr is no terminal.

    Yields:
        Function to call after every step with the number of steps done; figures to show are keywords.

    Example:
        >>> with progress("train", 100) as report:
        ...     report(1, loss=0.5)
    """
    started = last = time.perf_counter()

    def text(now: int, figures: dict[str, float]) -> str:
        rate = (now - done) / max(time.perf_counter() - started, 1e-9)
        shown = "  ".join([f"{rate:.1f} it/s", *(f"{key} {value:.6g}" for key, value in figures.items())])
        return f"{shown}  {(total - now) / max(rate, 1e-9):.0f} s left"

    def report_line(now: int, **figures: float) -> None:
        nonlocal last
        clock = time.perf_counter()
        if clock - last >= every_seconds or now >= total:
            last = clock
            print(f"{name} {now}/{total}  {text(now, figures)}", file=sys.stderr, flush=True)

    if not sys.stderr.isatty():
        yield report_line
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

    columns = (TextColumn(name), BarColumn(), MofNCompleteColumn(), TextColumn("{task.fields[text]}"))
    with Progress(*columns, console=Console(stderr=True)) as bars:
        task = bars.add_task(name, total=total, completed=done, text="")
        yield lambda now, **figures: bars.update(task, completed=now, text=text(now, figures))
