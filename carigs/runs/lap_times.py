"""Times of a step that a job repeats, such as the rendering of a frame; the job's record keeps their mean."""

from __future__ import annotations

import time
from collections import defaultdict
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from statistics import fmean

_laps: defaultdict[str, list[float]] = defaultdict(list)


@contextmanager
def timed(step: str) -> Iterator[None]:
    """Measure the wall time of one execution of a step.

    Args:
        step: Name of the step.

    Yields:
        Nothing.
    """
    started = time.perf_counter()
    yield
    _laps[step].append(time.perf_counter() - started)


def mean_times() -> Mapping[str, float]:
    """Mean wall time of each step in this process since `forget_times`.

    The first execution is left out if there are others: it loads compiled kernels.

    Returns:
        Seconds by step.
    """
    return {step: fmean(laps[1:] or laps) for step, laps in _laps.items()}


def forget_times() -> None:
    """Forget what was measured so far."""
    _laps.clear()
