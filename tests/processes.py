"""Processes of tests: started so that none outlives its test, and watched without a race."""

from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import psutil


@contextmanager
def started(command: Sequence[str], **options) -> Iterator[subprocess.Popen]:
    """A process that is killed and waited for at the end, also of a test that fails.

    Without that, the interpreter warns of it later, while some other test runs, and that test fails as well.
    """
    with subprocess.Popen(command, text=True, **options) as process:
        try:
            yield process
        finally:
            process.kill()  # does nothing to a process that has been waited for


def until(condition: Callable[[], object], seconds: float = 30.0):
    """The first true value of a condition; its last value if none is true in that time."""
    end = time.monotonic() + seconds
    while not (value := condition()) and time.monotonic() < end:
        time.sleep(0.02)
    return value


def has_ended(pid: int) -> bool:
    """True if a process is gone or a zombie.

    It is asked for once: between the questions whether it exists and what its state is, it may end.
    """
    try:
        return psutil.Process(pid).status() in (psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD)
    except psutil.NoSuchProcess:
        return True


def ends(pid: int, seconds: float = 30.0) -> bool:
    """True if a process ends in that time."""
    return bool(until(lambda: has_ended(pid), seconds))
