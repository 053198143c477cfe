"""What parts of the method are worth: trainings on a subject of a study, each without one part.

Every training is the variant `alternating` with the settings of its study, but for the number of steps: density control
and learning rates end with them. Frames are those of the tables: the held-out sequence, at level 0 and at gamma.

Example:
    python -m evaluation.benchmarks.parts_left_out parts.csv results/toy/toy/gamma=0.25 --steps 1000 --seeds 0 1
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np

from carigs.capture import Capture
from carigs.capture.frame_index import read_ground_truth
from carigs.capture.images import read_grey, read_rgb
from carigs.capture.target_index import TargetSet, read_targets, write_targets
from carigs.config import load_settings
from carigs.exaggeration import GammaPath
from carigs.gtstar.target_set import make_target_set
from carigs.hair import FoundHair, load_hair
from carigs.head import neutral, read_subject_path
from carigs.settings import Gtstar, Train
from carigs.simd.threads import use_threads
from carigs.splat.avatar import Avatar
from carigs.splat.training import subject as preparation
from carigs.splat.training.subject import Subject, prepare_subject
from carigs.splat.training.trainer import train_surfels
from evaluation.benchmarks.timing import Measurement, write_measurements
from evaluation.benchmarks.toy_training import HeldOutView, held_out_view, psnr_by_region
from evaluation.command_line import csv_parser, run
from evaluation.metrics.regions import surface_regions

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


@dataclass(frozen=True)
class StudySubject:
    """A subject of a study, with the targets of the variant `alternating`."""

    folder: Path
    """`results/STUDY/SUBJECT/gamma=GAMMA`."""
    capture: Capture
    path: GammaPath
    hair: FoundHair
    train: Train
    gtstar: Gtstar

    @classmethod
    def load(cls, folder: Path) -> StudySubject:
        """Read what the study has written.

        Args:
            folder: Its results for the subject at a gamma.

        Returns:
            The subject.

        Raises:
            InputError: A file is missing or malformed.
        """
        name, settings = folder.parent.name, folder.parent.parent / "settings"
        variant = f"subject={name},variant=alternating"
        capture = Capture.load(folder.parent / "capture.json")
        return cls(
            folder,
            capture,
            read_subject_path(folder / "path.npz", capture.model),
            load_hair(folder.parent / "hair.npz", len(capture.model.faces)),
            load_settings("train", settings / "train" / f"{variant},seed=0.yaml"),
            load_settings("gtstar", settings / "gtstar" / f"{variant}.yaml"),
        )

    def targets(self) -> TargetSet:
        """The targets of the study.

        Returns:
            GT* frames at gamma.
        """
        level = f"level={self.path.gamma_f:g}"
        return read_targets(self.folder / "targets/alternating" / level / "targets.json", self.capture)

    def targets_without_shadow(self, folder: Path) -> TargetSet:
        """Make targets in which hair casts no shadow.

        Args:
            folder: Empty folder to write to.

        Returns:
            GT* frames at gamma.
        """
        images, records, index = folder / "images", folder / "records", folder / "targets.json"
        images.mkdir()
        records.mkdir()
        settings = replace(self.gtstar, hair_extinction=0.0)
        caricature = self.path.at(self.path.gamma_f)
        entries = make_target_set(settings, self.capture, caricature, images, records, self.hair)
        write_targets(index, self.path.gamma_f, images, *entries)
        return read_targets(index, self.capture)

    def views(self, level: float) -> list[HeldOutView]:
        """The held-out frames with a true image.

        Args:
            level: Level of exaggeration.

        Returns:
            The frames with their regions.
        """
        capture, model, caricature, views = self.capture, self.capture.model, self.path.at(level), []
        surface = surface_regions(model, neutral(model, capture.parameters(capture.frames[0].timestep)))
        truth = read_ground_truth(self.folder / f"truth/level={level:g}/truth.json")
        for frame in capture.split("test"):
            key = frame.timestep, frame.camera
            if key in truth.images:
                images = read_rgb(truth.images[key]), read_grey(truth.masks[key])
                views.append(held_out_view(capture, frame, caricature, surface, *images))
        return views


def prepare_without(part: str, study: StudySubject, settings: Train, targets: TargetSet) -> tuple[Train, Subject]:
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
    density = replace(study.train.density, stop=2 * steps // 3)
    views = {level: study.views(level) for level in (0.0, study.path.gamma_f)}
    use_threads(1)
    for part in parts:
        for seed in seeds:
            common = replace(study.train, iterations=steps, density=density, threads=1, seed=seed)
            with TemporaryDirectory() as scratch:
                shaded = part != "shadow of the hair"
                targets = study.targets() if shaded else study.targets_without_shadow(Path(scratch))
                settings, subject = prepare_without(part, study, common, targets)
                surfels, _ = train_surfels(settings, subject, Path(scratch) / "checkpoint")
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
