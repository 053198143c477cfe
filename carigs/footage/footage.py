"""Frames of plain footage: a video, or a folder of photographs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int, UInt8


class TimedFrame(NamedTuple):
    """One frame of footage."""

    number: int
    """Position in the footage, counted from 0, before frames were chosen."""
    time: float
    """Seconds; of photographs the position."""
    image: UInt8[np.ndarray, "h w 3"]
    """sRGB, upright."""


@dataclass(frozen=True)
class Footage:
    """What is known of footage before its frames are decoded."""

    source: Path
    """The video or the folder."""
    width: int
    """Of the frames that are yielded, in pixels."""
    height: int
    numbers: tuple[int, ...]
    """Of the frames that are yielded."""
    times: Float[np.ndarray, " n"]
    """Of the same, in seconds and strictly ascending; of photographs their positions."""
    fps: float | None
    """Median of all frames of a video; None for photographs."""
    duration: float | None
    """From the first to the last frame of a video that can be decoded, in seconds."""
    focal_length: float | None
    """What the metadata say, in pixels of the yielded frames; None if they say nothing."""
    decode: Callable[[], Iterator[UInt8[np.ndarray, "h w 3"]]] = field(repr=False)
    """Starts at the first frame."""
    warnings: tuple[str, ...] = ()

    def at(self, positions: Sequence[int] | Int[np.ndarray, " m"]) -> Footage:
        """Some of the frames.

        Args:
            positions: Which of those that are yielded, ascending.

        Returns:
            Footage that yields them alone.
        """
        chosen = {int(position) for position in positions}
        return replace(
            self,
            numbers=tuple(self.numbers[position] for position in sorted(chosen)),
            times=self.times[sorted(chosen)],
            decode=lambda: (image for position, image in enumerate(self.decode()) if position in chosen),
        )

    def turned(self, quarter_turns: int, why: str) -> Footage:
        """The footage with turned frames.

        Args:
            quarter_turns: Clockwise.
            why: A sentence for the warnings.

        Returns:
            Footage that is upright.
        """
        width, height = (self.height, self.width) if quarter_turns % 2 else (self.width, self.height)
        return replace(
            self,
            width=width,
            height=height,
            decode=lambda: (np.ascontiguousarray(np.rot90(image, -quarter_turns)) for image in self.decode()),
            warnings=(*self.warnings, why),
        )

    def __len__(self) -> int:
        return len(self.numbers)

    def __iter__(self) -> Iterator[TimedFrame]:
        for number, time, image in zip(self.numbers, self.times, self.decode(), strict=True):
            yield TimedFrame(number, float(time), image)
