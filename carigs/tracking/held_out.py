"""Which frames are held out from training."""

from __future__ import annotations

from collections.abc import Callable

TRAINED, TESTED = 15, 5
"""Frames of the two kinds of blocks."""
LAST_SHARE = 0.25
"""Of a clip, for `last_quarter`."""
FEW_CAMERAS = 3
"""So many cameras train all, and frames of a clip are held out by time alone."""
EVERY = 8
"""Of the views of one moment, this one is held out."""


def blocks(count: int) -> list[str]:
    """Hold out 5 of every 20 frames.

    Held-out frames then show what training frames show. The end of a short clip often asks for poses that no training
    frame has.

    Args:
        count: Number of frames.

    Returns:
        `train` or `test` for each frame; the middle frame of each block is `val`. Of a clip that is shorter than two
        blocks, the last quarter is held out.
    """
    period = TRAINED + TESTED
    if count < period:
        return last_quarter(count)
    names = ["train" if i % period < TRAINED else "test" for i in range(count)]
    for middle in range(TRAINED + TESTED // 2, count, period):
        names[middle] = "val"
    return names


def last_quarter(count: int) -> list[str]:
    """Hold out the end of a clip, as published figures of monocular avatars do.

    Args:
        count: Number of frames.

    Returns:
        `train` or `test` for each frame; `val` for every fifth one of the end.
    """
    first = count - round(LAST_SHARE * count)
    return ["train" if i < first else "val" if (i - first) % TESTED == TESTED // 2 else "test" for i in range(count)]


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
        middle one of these is `val`. Of a clip before more than three cameras, the frontal one is `val`.
    """
    if count == 1:
        return [views(cameras)]
    names = [[name] * cameras for name in by_time(count)]
    if cameras > FEW_CAMERAS:
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
