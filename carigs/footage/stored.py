"""Decoded frames on disk: tracking reads them ten times, and frames of a telephone in 4K take long to decode."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import UInt8

from carigs.footage.footage import Footage


def stored(footage: Footage, images: Iterable[UInt8[np.ndarray, "h w 3"]], file: Path) -> Footage:
    """Write decoded frames to a file, from which they are read again.

    Args:
        footage: The footage.
        images: Its frames, as `footage.decode` yields them.
        file: File to create; it must stay as long as the footage is used. A frame takes 3 bytes for each pixel.

    Returns:
        Footage whose frames come from the file.
    """
    with file.open("wb") as opened:
        for image in images:
            opened.write(np.ascontiguousarray(image).data)
    shape = len(footage), footage.height, footage.width, 3
    return replace(footage, decode=lambda: map(np.asarray, np.memmap(file, np.uint8, "r", shape=shape)))
