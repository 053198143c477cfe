"""Rendered frames beside the same frames without the edit, in sequences whose neighbours are compared."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import NamedTuple

from carigs.capture import Capture
from carigs.capture.frame_index import RenderedImage
from carigs.errors import InputError


class Pair(NamedTuple):
    """A rendered frame and the same frame without the edit."""

    frame: RenderedImage
    original: Path
    """Of a test frame: the image of the capture. Of the orbit: the frame rendered at level 0."""


Sequences = dict[str, list[list[Pair]]]
"""Sequences of adjacent frames by protocol."""


def frame_sequences(rendered: list[RenderedImage], unedited: list[RenderedImage], subject: Capture) -> Sequences:
    """Arrange the test frames and the orbit.

    Args:
        rendered: Rendered frames.
        unedited: The same frames rendered at level 0.
        subject: The capture, with the original frames.

    Returns:
        The test frames of each camera by timestep, and the orbit by azimuth.

    Raises:
        InputError: The original of a rendered frame is missing.
    """
    images = {(frame.timestep, frame.camera): subject.root / frame.image for frame in subject.frames}
    cameras: dict[int, list[Pair]] = defaultdict(list)
    for frame in sorted(_of("test", rendered), key=lambda frame: (frame.camera, frame.timestep)):
        if (frame.timestep, frame.camera) not in images:
            missing = f"timestep {frame.timestep}, camera {frame.camera}"
            raise InputError(f"the capture has no frame of {missing}", file=frame.file)
        cameras[frame.camera].append(Pair(frame, images[frame.timestep, frame.camera]))
    level_0 = {(frame.timestep, frame.camera): frame.file for frame in _of("orbit", unedited)}
    orbit = []
    for frame in _of("orbit", rendered):
        if (frame.timestep, frame.camera) not in level_0:
            raise InputError("this frame of the orbit was not rendered at level 0", file=frame.file)
        orbit.append(Pair(frame, level_0[frame.timestep, frame.camera]))
    return {"test": list(cameras.values()), "orbit": [orbit] if orbit else []}


def _of(protocol: str, frames: list[RenderedImage]) -> list[RenderedImage]:
    return [frame for frame in frames if frame.protocol == protocol]
