"""Mattes that are made in a thread of their own while something else, such as the tracker's solver, is at work."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from queue import Empty, Queue
from threading import Event, Thread

from carigs.matting.mattes import MattedFrame

MEGABYTES = 1024
"""Memory for mattes that nobody has asked for yet."""
BYTES = 16
"""That a pixel takes: alpha and three colours."""


@contextmanager
def computed_ahead(
    mattes: Iterable[MattedFrame], pixels: int, megabytes: int = MEGABYTES
) -> Iterator[Iterator[MattedFrame]]:
    """Begin with mattes before somebody asks for them.

    Args:
        mattes: As `matted_frames` makes them.
        pixels: Of the largest image.
        megabytes: Memory for those that wait; the thread stands still when it is full. One always has room.

    Yields:
        The same mattes in the same order. The thread ends with the context, at the latest after the matte that it is
        making.

    Raises:
        BaseException: What goes wrong with a matte, where it is asked for.
    """
    made: Queue[MattedFrame | BaseException | None] = Queue(max(megabytes * 2**20 // (BYTES * pixels), 1))
    unwanted = Event()

    def make() -> None:
        try:
            for matted in mattes:
                made.put(matted)
                if unwanted.is_set():
                    return
            made.put(None)
        except BaseException as error:  # whatever it is: it belongs to whoever waits for the matte
            made.put(error)

    def asked_for() -> Iterator[MattedFrame]:
        while (matted := made.get()) is not None:
            if isinstance(matted, BaseException):
                raise matted
            yield matted

    thread = Thread(target=make, name="mattes", daemon=True)
    thread.start()
    try:
        yield asked_for()
    finally:
        unwanted.set()
        while thread.is_alive():
            _make_room(made)
            thread.join(0.05)


def _make_room(queue: Queue) -> None:
    """Throw away what is in a queue, on which a thread may wait."""
    try:
        while True:
            queue.get_nowait()
    except Empty:
        pass
