"""What parts of the method are worth: trainings on a subject of a study, each without one part.

Every training is the variant `alternating` with the settings of its study, but for the number of steps: density control
and learning rates end with them. Frames are those of the tables: the held-out sequence, at level 0 and at gamma.

Example:
    python -m evaluation.benchmarks.parts_left_out parts.csv results/toy/toy/gamma=0.25 --steps 1000 --seeds 0 1
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np

from carigs.capture.target_index import TargetSet
from carigs.settings import Train
from carigs.simd.threads import use_threads
from carigs.splat.avatar import Avatar
from carigs.splat.training import subject as preparation
from carigs.splat.training.subject import TrainingSubject, prepare_subject
from carigs.splat.training.trainer import train_surfels
from evaluation.benchmarks.measurement.study_subject import StudySubject
from evaluation.benchmarks.measurement.timing import Measurement, write_measurements
from evaluation.benchmarks.measurement.toy_training import psnr_by_region
from evaluation.command_line import csv_parser, run

PARTS = (
    "nothing",
    "surfels inside the hair",
    "smooth motion of the scalp",
    "opaque hidden skin",
    "flag covered",
    "shadow of the hair",
    "brows that keep their size",
    "surfels inside the mouth",
)
"""What is left out. Without surfels inside the hair, there is neither smooth motion nor opaque hidden skin."""


def prepare_without(
    part: str, study: StudySubject, settings: Train, targets: TargetSet
) -> tuple[Train, TrainingSubject]:
    """Prepare a training that lacks a part.

    Args:
        part: One of `PARTS`.
        study: The subject.
        settings: Settings of the training.
        targets: GT* frames; those without the shadow of the hair if it is the part.

    Returns:
        Settings, and what the training is about.
    """
    stretching = nullcontext()
    if part == "surfels inside the hair":
        settings = replace(settings, hair_layers=0)
    elif part == "surfels inside the mouth":
        settings = replace(settings, mouth_surfels=0)
    elif part == "flag covered":
        settings = _without_flag(settings, "covered")
    elif part == "brows that keep their size":
        settings = _without_flag(settings, "brows")
        stretching = patch.object(preparation, "keep_size_of_brows")
    with stretching:
        subject = prepare_subject(study.capture, study.path, settings, study.hair, [targets])
    if part == "smooth motion of the scalp":
        subject.sequence.smooth = None
    elif part == "opaque hidden skin" and subject.hair is not None:
        none = np.zeros_like(subject.hair.hidden)
        subject = subject._replace(hair=replace(subject.hair, covered=none, hidden=none))
    return settings, subject


def _without_flag(settings: Train, flag: str) -> Train:
    return replace(settings, mask_flags=tuple(name for name in settings.mask_flags if name != flag))


def measure(
    folder: Path, parts: Sequence[str] = PARTS, seeds: Sequence[int] = (0, 1), steps: int = 1000
) -> Iterator[Measurement]:
    """Train without each part, on one thread.

    Args:
        folder: Results of the subject at its gamma: `results/STUDY/SUBJECT/gamma=GAMMA`.
        parts: What is left out, one at a time.
        seeds: Seeds of the trainings.
        steps: Number of steps.

    Yields:
        PSNR of every region at both levels; the mean over the frames that show it.
    """
    study = StudySubject.load(folder)
    views = {level: study.views(level) for level in (0.0, study.path.gamma_f)}
    use_threads(1)
    for part in parts:
        for seed in seeds:
            common = replace(study.settings_for(steps), seed=seed)
            with TemporaryDirectory() as scratch:
                shaded = part != "shadow of the hair"
                targets = study.targets() if shaded else study.targets_without_shadow(Path(scratch))
                settings, subject = prepare_without(part, study, common, targets)
                surfels, _ = train_surfels(settings, subject)
            rendering = settings.rig, settings.rotate_harmonics, study.capture.background
            avatar = Avatar(surfels, subject.sequence, *rendering)
            case = f"{folder.parent.name}, {part}, seed {seed}"
            for level, frames in views.items():
                for region, value in psnr_by_region(avatar, level, frames).items():
                    yield Measurement(case, f"PSNR at level {level:g}, {region}", "dB", value)


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("folder", type=Path, help="results/STUDY/SUBJECT/gamma=GAMMA, with true caricatures")
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=PARTS, metavar="PART", help="what is left out")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1])
    parser.add_argument("--steps", type=int, default=1000)
    task = parser.parse_args()
    write_measurements(task.rows, measure(task.folder, task.parts, task.seeds, task.steps))


if __name__ == "__main__":
    run(main)
