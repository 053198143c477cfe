"""Results of a function in the order of its arguments, computed by threads."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Argument, Result = TypeVar("Argument"), TypeVar("Result")


def in_order(function: Callable[[Argument], Result], arguments: Iterable[Argument], threads: int) -> Iterator[Result]:
    """Apply a function in threads, with few arguments and results in memory.

    It is worth it for functions that spend their time where Python's lock is free: in kernels, OpenCV, large arrays.

    Args:
        function: May be called by several threads at once.
        arguments: They are taken as threads become free, by the thread that asks for results.
        threads: Number of threads.

    Yields:
        The results. What a call raises is raised in its place.
    """
    waiting: deque[Future[Result]] = deque()
    with ThreadPoolExecutor(threads) as pool:
        for argument in arguments:
            waiting.append(pool.submit(function, argument))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
