"""Which frames of a clip are held out from training."""

from __future__ import annotations

TRAINED, TESTED = 15, 5
"""Frames of the two kinds of blocks."""
LAST_SHARE = 0.25
"""Of a clip, for `last_quarter`."""


def blocks(count: int) -> list[str]:
    """Hold out 5 of every 20 frames.

    Held-out frames then show what training frames show. The end of a short clip often asks for poses that no training
    frame has.

    Args:
        count: Number of frames.

    Returns:
        `train` or `test` for each frame; the middle frame of each block is `val`.
    """
    period = TRAINED + TESTED
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
