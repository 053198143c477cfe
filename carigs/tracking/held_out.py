"""Which frames are held out from training."""

from __future__ import annotations

from collections.abc import Callable

from carigs.capture.splits import ENOUGH_CAMERAS, blocks, last_quarter

EVERY = 8
"""Of the views of one moment, this one is held out."""
SPLITS = {"blocks": blocks, "last_quarter": last_quarter}
"""By the names that settings have."""


def held_out(count: int, cameras: int, frontal: int, by_time: Callable[[int], list[str]] = blocks) -> list[list[str]]:
    """Name the split of every frame.

    Args:
        count: Number of timesteps.
        cameras: Number of cameras.
        frontal: The camera that sees the face most from the front.
        by_time: Names the splits of the timesteps of a clip.

    Returns:
        `train`, `val` or `test` for each timestep and camera. Of one moment, every eighth view is held out, and the
        middle one of these is `val`. Of a clip before six cameras or more, the frontal one is `val`.
    """
    if count == 1:
        return [views(cameras)]
    names = [[name] * cameras for name in by_time(count)]
    if cameras >= ENOUGH_CAMERAS:
        for row in names:
            row[:] = ["train" if name == "train" else "test" for name in row]
            row[frontal] = "val" if row[frontal] == "train" else row[frontal]
    return names


def views(count: int) -> list[str]:
    """Hold out views of one moment.

    Args:
        count: Number of views, in the order in which they were taken.

    Returns:
        `train`, `val` or `test` for each; at least one is held out.
    """
    first = min(EVERY // 2, count // 2)
    held = [*range(first, count, EVERY)]
    middle = held[len(held) // 2] if len(held) > 1 else -1
    return ["val" if i == middle else "test" if i in held else "train" for i in range(count)]
