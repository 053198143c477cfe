"""Which frames of a video are tracked."""

from __future__ import annotations

from math import ceil
from pathlib import Path

from carigs.errors import InputError
from carigs.footage import Footage, Selection, read_video

SHORTEST = 1.0
"""Seconds."""


def chosen_frames(video: Path, frame_rate: float, largest_side: int) -> Footage:
    """Choose every n-th frame of a video, so that there are no more per second than wanted.

    Args:
        video: The video.
        frame_rate: Most frames per second.
        largest_side: Larger frames are scaled down to this number of pixels.

    Returns:
        The frames.

    Raises:
        InputError: If the video cannot be read, or is shorter than a second.
    """
    if Path(video).is_dir():
        raise InputError("is a folder; a video is expected", file=video)
    footage = read_video(video, Selection(largest_side=largest_side))
    if footage.duration < SHORTEST:
        raise InputError(f"{footage.duration:.2f} s long; at least {SHORTEST:g} s are needed", file=video)
    every = max(ceil(footage.fps / frame_rate - 1e-6), 1)
    return read_video(video, Selection(every=every, largest_side=largest_side)) if every > 1 else footage
