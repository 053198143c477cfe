"""Which frames of footage are used, and how large they are."""

from __future__ import annotations

from dataclasses import dataclass
from math import ceil

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from carigs.capture.evenly_spread import evenly_spread
from carigs.errors import SettingsError


@dataclass(frozen=True)
class Selection:
    """Frames that are used, and their size."""

    every: int = 1
    """Use every n-th frame of those between start and end."""
    start: float = 0.0
    """Seconds after the first frame."""
    end: float | None = None
    """Seconds after the first frame; None for the end of the footage."""
    max_frames: int | None = None
    """Most frames, evenly spread over those that are left."""
    at: tuple[float, ...] | None = None
    """Use the frames nearest to these seconds after the first frame, and no others; None for all."""
    largest_side: int | None = None
    """Larger frames are scaled down to this number of pixels."""
    frame_rate: float | None = None
    """Every n-th frame is used, so that there are no more per second than this; None for all. Replaces `every`."""

    def __post_init__(self) -> None:
        for name in ("every", "max_frames", "largest_side"):
            value = getattr(self, name)
            if value is not None and value < 1:
                raise SettingsError(f"{name}={value}: expected at least 1")
        if not self.start >= 0 or (self.end is not None and not self.end > self.start):
            raise SettingsError(f"start={self.start}, end={self.end}: expected 0 <= start < end, in seconds")

    def frames(self, times: Float[np.ndarray, " n"]) -> list[int]:
        """Choose frames.

        Args:
            times: Of all frames, in seconds; ascending.

        Returns:
            Numbers of the chosen ones, ascending.
        """
        since_first = times - times[:1]
        if self.at is not None:
            return [int(np.abs(since_first - second).argmin()) for second in self.at]
        every = self.every if self.frame_rate is None else _every(times, self.frame_rate)
        inside = (since_first >= self.start) & (since_first <= (np.inf if self.end is None else self.end))
        chosen = [int(number) for number in np.flatnonzero(inside)[::every]]
        return chosen if self.max_frames is None else evenly_spread(chosen, self.max_frames)

    def size(self, width: int, height: int) -> tuple[int, int]:
        """Size that frames are scaled to.

        Args:
            width: Of the frames of the footage, in pixels.
            height: Of the same.

        Returns:
            Width and height in pixels; no side is larger than before.
        """
        scale = min(1.0, (self.largest_side or max(width, height)) / max(width, height))
        return max(round(width * scale), 1), max(round(height * scale), 1)


def _every(times: Float[np.ndarray, " n"], frame_rate: float) -> int:
    """Which n makes every n-th frame come at most so often."""
    return max(ceil(1 / float(np.median(np.diff(times))) / frame_rate - 1e-6), 1) if len(times) > 1 else 1


def scaled_down(image: UInt8[np.ndarray, "h w 3"], size: tuple[int, int]) -> UInt8[np.ndarray, "h2 w2 3"]:
    """Scale an image by the mean of the pixels that fall together.

    Args:
        image: The image.
        size: Width and height in pixels, as `Selection.size` gives them.

    Returns:
        The scaled image; the image itself if it has that size.
    """
    return image if image.shape[1::-1] == size else cv2.resize(image, size, interpolation=cv2.INTER_AREA)
