"""How far mattes that `carigs track` makes are from the true ones: a person who talks before four backgrounds.

The error is the mean absolute difference of alpha within 10 pixels of the true outline. The coarse matte is that of the
network `selfie_segmentation`, of which the boxes of the face tell the person; these are the true ones.

Example:
    python -m evaluation.benchmarks.footage.matte_errors toy.csv
    python -m evaluation.benchmarks.footage.matte_errors ict.csv --dataset ict_s1 --head-model ict_model.npz
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float

from carigs.capture import read_dataset
from carigs.detection.person import PersonSegmenter, load_person_segmenter
from carigs.matting.mattes import at_size
from carigs.settings import Track
from carigs.tracking.video import person_mattes
from evaluation.benchmarks.footage.backgrounds import KINDS
from evaluation.benchmarks.footage.motion import Talk
from evaluation.benchmarks.footage.oracle_landmarks import EXACT
from evaluation.benchmarks.footage.oracle_recordings import (
    SEED,
    Filmed,
    filmed_dataset,
    filmed_toy,
    oracle_recordings,
    toy_subject,
)
from evaluation.benchmarks.measurement.timing import Measurement, write_measurements
from evaluation.command_line import csv_parser, run

BAND = 10
"""Pixels to either side of the outline."""


def band(alpha: Float[np.ndarray, "h w"]) -> Bool[np.ndarray, "h w"]:
    """Find the pixels near an outline.

    Args:
        alpha: The matte, in [0, 1].

    Returns:
        Those that are at most `BAND` pixels from where it passes 0.5.
    """
    inside = (alpha >= 0.5).astype(np.uint8)
    distances = [cv2.distanceTransform(part, cv2.DIST_L2, 5) for part in (inside, 1 - inside)]
    return np.maximum(*distances) <= BAND


def measure(name: str, filmed: Filmed, segmenter: PersonSegmenter) -> Iterator[Measurement]:
    """Make the mattes of footage of one camera, and compare them with the true ones.

    Args:
        name: Of the measurements.
        filmed: The footage.
        segmenter: Finds people.

    Yields:
        Error of the mattes, and of the network's coarse ones.
    """
    [recording] = oracle_recordings(filmed, EXACT)
    refined, coarse = [], []
    made = person_mattes(recording, np.arange(len(filmed.mattes[0])), segmenter)
    for (frame, alpha, _), matte in zip(made, filmed.mattes[0], strict=True):
        true = matte / 255
        near = band(true)
        refined.append(np.abs(alpha - true)[near].mean())
        coarse.append(np.abs(at_size(segmenter(frame.image), true.shape) - true)[near].mean())
    yield Measurement(name, "error near the outline", "", float(np.mean(refined)))
    yield Measurement(name, "error of the coarse mattes", "", float(np.mean(coarse)))


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("--seconds", type=float, default=4.0)
    parser.add_argument("--hair", nargs="+", choices=("short", "long"), default=["short", "long"], help="of the toy")
    parser.add_argument("--dataset", type=Path, help="frames of this dataset in place of the toy")
    parser.add_argument("--head-model", type=Path, help="of the dataset")
    task = parser.parse_args()
    people: dict[str, Callable[[str], Filmed]] = {}
    if task.dataset is None:
        talk = Talk(task.seconds, Track().frame_rate, seed=SEED)
        for hair in task.hair:
            subject = toy_subject(hair=hair)
            people[f"{hair} hair"] = lambda behind, subject=subject: filmed_toy(subject, "talk", talk, behind=behind)
    else:
        capture = read_dataset(task.dataset, task.head_model)
        people[task.dataset.name] = lambda behind: filmed_dataset(capture, "talk", behind=behind)
    segmenter = load_person_segmenter()
    cases = ((f"{name}, {behind}", film(behind)) for name, film in people.items() for behind in KINDS)
    write_measurements(task.rows, (row for name, filmed in cases for row in measure(name, filmed, segmenter)))


if __name__ == "__main__":
    run(main)
