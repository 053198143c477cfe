"""Mattes that a thread makes while something else is at work."""

import threading
import time

import numpy as np
import pytest

from carigs.footage import TimedFrame
from carigs.matting import MattedFrame
from carigs.matting.computed_ahead import BYTES, computed_ahead

SIDE = 8
PIXELS = SIDE * SIDE


def matted(number: int) -> MattedFrame:
    image = np.full((SIDE, SIDE, 3), number, np.uint8)
    return MattedFrame(TimedFrame(number, 0.0, image), np.zeros((SIDE, SIDE), np.float32), image / np.float32(255))


class Source:
    """Mattes that are counted as they are made."""

    def __init__(self, count: int, failure: BaseException | None = None) -> None:
        self.count, self.failure, self.made = count, failure, 0

    def __iter__(self):
        for number in range(self.count):
            self.made += 1
            yield matted(number)
        if self.failure is not None:
            raise self.failure


def wait_until(condition) -> bool:
    end = time.monotonic() + 30
    while not condition() and time.monotonic() < end:
        time.sleep(0.005)
    return condition()


def threads() -> int:
    return sum(thread.name == "mattes" for thread in threading.enumerate())


def test_they_are_made_before_somebody_asks_and_come_in_order():
    source = Source(5)
    with computed_ahead(source, PIXELS) as mattes:
        assert wait_until(lambda: source.made == 5)
        assert [each.frame.number for each in mattes] == [0, 1, 2, 3, 4]


def test_an_error_is_raised_where_its_matte_is_asked_for():
    with computed_ahead(Source(2, OSError("the disk")), PIXELS) as mattes:
        assert [next(mattes).frame.number, next(mattes).frame.number] == [0, 1]
        with pytest.raises(OSError, match="the disk"):
            next(mattes)


def test_no_more_wait_than_memory_allows():
    source = Source(100)
    with computed_ahead(source, 2**20 // (3 * BYTES), megabytes=1) as mattes:
        assert wait_until(lambda: source.made == 4)  # three that wait, and one that is made
        time.sleep(0.1)
        assert source.made == 4
        assert len(list(mattes)) == 100


@pytest.mark.parametrize("taken", [0, 1])
def test_the_thread_ends_with_the_context_whatever_happens_in_it(taken):
    source = Source(10**9)
    with pytest.raises(ValueError, match="the solver"), computed_ahead(source, 2**20 // BYTES, megabytes=2) as mattes:
        for _ in range(taken):
            next(mattes)
        raise ValueError("the solver")
    assert not threads()
    made = source.made
    time.sleep(0.05)
    assert source.made == made
