"""Cache of decoded images within a budget of memory; a separate thread decodes images ahead of their use."""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path

from jaxtyping import UInt
from numpy import ndarray

Pixels = UInt[ndarray, "h w *c"]


class ImageCache:
    """Least-recently-used cache of images.

    Args:
        megabytes: Budget of memory; at least one image is kept.
    """

    def __init__(self, megabytes: float) -> None:
        self.limit = int(megabytes * 2**20)
        self._images: OrderedDict[Path, Future[Pixels]] = OrderedDict()
        self._sizes: dict[Path, int] = {}
        self._decoder = ThreadPoolExecutor(1)

    def prefetch(self, file: Path, read: Callable[[Path], Pixels]) -> None:
        """Begin to decode a file, unless it is in the cache.

        Args:
            file: Image file.
            read: Decodes a file.
        """
        if file not in self._images:
            self._images[file] = self._decoder.submit(read, file)

    def get(self, file: Path, read: Callable[[Path], Pixels]) -> Pixels:
        """Get the image of a file, from the cache if possible.

        Args:
            file: Image file.
            read: Decodes a file; its exceptions are raised here, also those of a prefetch.

        Returns:
            The pixels.
        """
        self.prefetch(file, read)
        self._images.move_to_end(file)
        pixels = self._images[file].result()
        self._sizes[file] = pixels.nbytes
        while sum(self._sizes.values()) > self.limit and len(self._sizes) > 1:
            oldest, image = self._images.popitem(last=False)
            image.cancel()
            self._sizes.pop(oldest, None)
        return pixels
