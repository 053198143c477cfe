"""Decoded images within a budget of memory; a thread of its own decodes ahead."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from jaxtyping import UInt
from numpy import ndarray

Pixels = UInt[ndarray, "h w *c"]


class ImageCache:
    """The images that were used last, as bytes: at most `megabytes` of them, and at least one."""

    def __init__(self, megabytes: float) -> None:
        self.limit = int(megabytes * 2**20)
        self._images: OrderedDict[Path, Future[Pixels]] = OrderedDict()
        self._sizes: dict[Path, int] = {}
        self._decoder = ThreadPoolExecutor(1)

    def ask(self, file: Path, read: Callable[[Path], Pixels]) -> None:
        """Begin to decode a file that will be wanted, unless it is here."""
        if file not in self._images:
            self._images[file] = self._decoder.submit(read, file)

    def get(self, file: Path, read: Callable[[Path], Pixels]) -> Pixels:
        """The image of a file; raises what `read` raised."""
        self.ask(file, read)
        self._images.move_to_end(file)
        pixels = self._images[file].result()
        self._sizes[file] = pixels.nbytes
        while sum(self._sizes.values()) > self.limit and len(self._sizes) > 1:
            oldest, image = self._images.popitem(last=False)
            image.cancel()
            self._sizes.pop(oldest, None)
        return pixels
