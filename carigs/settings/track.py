"""Settings of tracking: a plain video becomes a dataset."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.settings.option import Section, option, set_by


@dataclass
class Track(Section, key="track"):
    """The head of one person, tracked before one static camera; used when `capture.source` is `video`."""

    video: str | None = set_by("capture.video", None, is_path=True)
    """The video."""
    head_model: str | None = set_by("capture.head_model", None, is_path=True)
    """The head model that is fitted."""
    background: float = set_by("capture.background", 1.0, ge=0, le=1)
    """Grey value that frames are composited on."""
    frame_rate: float = option(12.5, unit="1/s", gt=0, le=240)
    """Frames per second that are used, at most."""
    largest_side: int = option(640, unit="pixels", ge=64, le=8192)
    """Larger frames are scaled down to this side."""
    focal_length: float | None = option(None, unit="pixels", gt=0, le=1_000_000)
    """Of the video's frames. Null: estimated, with a field of view of 60 degrees as the guess; landmarks determine it
    poorly."""
    body: str = option("cut", choices=("cut", "keep"))
    """Whether mattes end below the chin, or keep neck, shoulders and clothes."""
    held_out: str = option("blocks", choices=("blocks", "last_quarter"))
    """Which frames are held out: 5 of every 20, or the last quarter."""
    embedding: str | None = option(None, is_path=True)
    """File of MediaPipe's landmarks on the head model. Null: they are placed as `carigs head embed` places them."""
