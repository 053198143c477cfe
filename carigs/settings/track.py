"""Settings of tracking: a plain video becomes a dataset."""

from __future__ import annotations

from dataclasses import dataclass

from carigs.settings.option import Section, option, set_by


@dataclass
class Track(Section, key="track"):
    """The head of one person, tracked in footage without calibration; used when `capture.source` is `video`."""

    video: str | None = set_by("capture.video", None, is_path=True)
    """The footage."""
    footage: str = option("auto", choices=("auto", "talk", "orbit", "photographs"))
    """`talk`: a person who talks before one camera, or several in step, that stand still; `orbit`: a camera that
    circles a person who keeps still; `photographs`: a folder of images of one moment. `auto` finds out."""
    head_model: str | None = set_by("capture.head_model", None, is_path=True)
    """The head model that is fitted."""
    background: float = set_by("capture.background", 1.0, ge=0, le=1)
    """Grey value that frames are composited on."""
    frame_rate: float = option(12.5, unit="1/s", gt=0, le=240)
    """Frames per second that are used, at most."""
    largest_side: int = option(640, unit="pixels", ge=64, le=8192)
    """Larger frames are scaled down to this side."""
    focal_length: float | None = option(None, unit="pixels", gt=0, le=1_000_000)
    """Of the frames as they were recorded, in all cameras. Null: estimated, with what the metadata say or a field of
    view of 60 degrees as the guess; landmarks determine it poorly."""
    held_out: str = option("blocks", choices=("blocks", "last_quarter"))
    """Which frames of a clip are held out: 5 of every 20, or the last quarter. Of one moment, every eighth view is."""
    embedding: str | None = option(None, is_path=True)
    """File of MediaPipe's landmarks on the head model. Null: they are placed as `carigs head embed` places them."""
