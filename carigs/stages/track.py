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
from carigs.tracking.video import VideoReport, track_video


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
    if dataset.exists():
        shutil.rmtree(dataset)
    track_and_report(settings, dataset)


def track_and_report(settings: Track, dataset: Path, weights: Path | None = None) -> VideoReport:
    """Track a video with progress on the terminal, and print errors, the focal length and advice.

    Args:
        settings: The video, the head model, and how they are read.
        dataset: Dataset to create.
        weights: Folder of weights that is searched first.

    Returns:
        What was printed.

    Raises:
        CarigsError: As for `track`.

    Warns:
        CarigsWarning: As for `track`.
    """
    console = Console(stderr=True)
    report = track_video(
        settings,
        dataset,
        weights=weights,
        progress=lambda items, name, count: shown(
            items, name, count, console=console, transient=True, disable=not sys.stderr.isatty()
        ),
        status=console.status,
    )
    print(report.errors)
    print(f"focal length {report.focal_length:.0f} pixels; the guess was {report.focal_guess:.0f}")
    for line in report.advice:
        warnings.warn(CarigsWarning(line), stacklevel=2)
    return report
