"""Stage `track`: footage without calibration becomes a dataset."""

from __future__ import annotations

import shutil
import sys
import warnings
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import track as shown

from carigs.errors import CarigsWarning
from carigs.settings import Track
from carigs.tracking.video import VideoReport, track_video


def track(settings: Track, *, dataset: Path) -> None:
    """Track the head of a person.

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


def track_and_report(
    settings: Track, dataset: Path, *, sources: Sequence[Path] | None = None, weights: Path | None = None
) -> VideoReport:
    """Track footage with progress on the terminal, and print its kind, errors, test poses, focal lengths and advice.

    Args:
        settings: The footage, the head model, and how they are read.
        dataset: Dataset to create.
        sources: The recordings of the cameras, in place of those that the settings name.
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
        sources=sources,
        weights=weights,
        progress=lambda items, name, count: shown(
            items, name, count, console=console, transient=True, disable=not sys.stderr.isatty()
        ),
        status=console.status,
    )
    print(report.kind)
    print(report.errors)
    print(report.held_out)
    found, guessed = (", ".join(f"{f:.0f}" for f in fs) for fs in (report.focal_lengths, report.focal_guesses))
    print(f"focal length {found} pixels; the guess was {guessed}")
    for line in report.advice:
        warnings.warn(CarigsWarning(line), stacklevel=2)
    return report
