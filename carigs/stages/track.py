"""Stage `track`: a video becomes a dataset."""

from __future__ import annotations

import shutil
import sys
import warnings
from pathlib import Path

from rich.console import Console
from rich.progress import track as shown

from carigs.errors import CarigsWarning
from carigs.settings import Track
from carigs.tracking.video import VideoOptions, track_video


def track(settings: Track, *, dataset: Path) -> None:
    """Track the head of a person in a video.

    Args:
        settings: Settings of the stage.
        dataset: Output: the dataset.

    Raises:
        CarigsError: If a package or weights are missing, or the video cannot be used.

    Warns:
        CarigsWarning: What to record otherwise.
    """
    console = Console(file=sys.stderr)
    if dataset.exists():
        shutil.rmtree(dataset)
    report = track_video(
        Path(settings.video),
        Path(settings.head_model),
        dataset,
        options=video_options(settings),
        embedding=settings.embedding and Path(settings.embedding),
        progress=lambda items, name, count: shown(
            items, name, count, console=console, transient=True, disable=not sys.stderr.isatty()
        ),
        status=console.status,
    )
    print(report.errors)
    print(f"focal length {report.focal_length:.0f} pixels; the guess was {report.focal_guess:.0f}")
    for line in report.advice:
        warnings.warn(line, CarigsWarning, stacklevel=2)


def video_options(settings: Track) -> VideoOptions:
    """The settings as the tracker takes them.

    Args:
        settings: Settings of the stage.

    Returns:
        The options.
    """
    return VideoOptions(
        frame_rate=settings.frame_rate,
        largest_side=settings.largest_side,
        focal_length=settings.focal_length,
        keep_body=settings.body == "keep",
        held_out=settings.held_out,
        background=settings.background,
    )
