"""What wrong tracking costs, and what `train.refine_tracking` mends: trainings on frames of the procedural subject.

The head of every training timestep is moved by 1 mm and turned by 8 mrad (jaw: 10 mrad) at random per axis, or left as
it is. Frames of the held-out sequence are rendered with their exact tracking. The hair is that of the exact tracking.

Example:
    python -m evaluation.benchmarks.tracking_errors tracking.csv --steps 1500
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np

from carigs.capture import Capture, Frame
from carigs.exaggeration import GammaPath
from carigs.hair import find_hair
from carigs.head import HeadParameters, pose
from carigs.head.model_arrays import FLAME_JOINTS
from carigs.settings import Density, Hair, RefineTracking, Toy, Train
from carigs.simd.threads import use_threads
from carigs.splat.avatar import Avatar
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.training.subject import prepare_subject
from carigs.splat.training.trainer import train_surfels
from evaluation.benchmarks.measurement.timing import Measurement, write_measurements
from evaluation.benchmarks.measurement.toy_frames import write_subject
from evaluation.benchmarks.measurement.toy_training import in_eight_bits
from evaluation.command_line import csv_parser, run
from evaluation.metrics.image_quality import psnr

METRES, RADIANS, JAW_RADIANS = 1e-3, 8e-3, 10e-3
"""Standard deviations of the errors per axis."""
DEFAULT = RefineTracking(until=0.5)


class Case(NamedTuple):
    """A training."""

    name: str
    wrong: bool
    """Whether the tracking is wrong."""
    refinement: RefineTracking


def slower(until: float, factor: float) -> RefineTracking:
    """A refinement with other rates than the default.

    Args:
        until: Share of the steps that refine.
        factor: Rates over the default ones.

    Returns:
        The settings.
    """
    rates = {name: factor * getattr(DEFAULT, name) for name in ("translation_lr", "expression_lr")}
    return replace(DEFAULT, until=until, **rates)


CASES = [
    Case(f"{'wrong' if wrong else 'exact'}, {name}", wrong, refinement)
    for wrong in (False, True)
    for name, refinement in (
        ("not refined", RefineTracking()),
        ("first half", DEFAULT),
        ("first half, 2/3 of the rate", slower(0.5, 2 / 3)),
        ("all steps, 1/3 of the rate", slower(1.0, 1 / 3)),
    )
]


def disturbed(parameters: HeadParameters, rng: np.random.Generator) -> HeadParameters:
    """Move a head as a tracker may.

    Args:
        parameters: The exact parameters.
        rng: Source of the errors.

    Returns:
        Other parameters.
    """
    joints = parameters.joints.copy()
    joints[FLAME_JOINTS.index("jaw") - 1] += JAW_RADIANS * rng.normal(size=3)
    translation, rotation = METRES * rng.normal(size=3), RADIANS * rng.normal(size=3)
    return replace(
        parameters,
        translation=parameters.translation + translation,
        rotation=parameters.rotation + rotation,
        joints=joints,
    )


def distance(sequence: HeadSequence, exact: dict[int, HeadParameters]) -> float:
    """How far the heads of a sequence are from the true ones; what all timesteps share is no error of the tracking.

    Args:
        sequence: The heads.
        exact: True parameters by timestep.

    Returns:
        Root mean square over vertices and timesteps in metres.
    """
    offsets = [pose(sequence.head, sequence.parameters[t]) - pose(sequence.head, p) for t, p in exact.items()]
    squared = ((np.array(offsets) - np.mean(offsets, axis=0)) ** 2).sum(axis=2)
    return float(np.sqrt(squared.mean()))


def mean_psnr(avatar: Avatar, capture: Capture, frames: list[Frame]) -> float:
    """Mean PSNR at level 0.

    Args:
        avatar: The avatar.
        capture: The capture.
        frames: Frames to compare.

    Returns:
        PSNR in dB.
    """
    images = ((avatar.render(f.timestep, 0.0, capture.camera(f)), capture.image(f)) for f in frames)
    return float(np.mean([psnr(in_eight_bits(image), truth) for image, truth in images]))


def measure(folder: Path, toy: Toy, steps: int, cases: list[Case]) -> Iterator[Measurement]:
    """Train all cases on one thread.

    Args:
        folder: Empty folder for the capture.
        toy: Settings of the subject.
        steps: Number of steps.
        cases: The trainings.

    Yields:
        Distance of the heads from the true ones, and PSNR of training frames and held-out frames, of every case.
    """
    use_threads(1)
    write_subject(folder, toy)
    capture, path = Capture.load(folder / "capture.json"), GammaPath.load(folder / "path.npz")
    found = find_hair(Hair(), capture)
    exact = {frame.timestep: capture.parameters(frame.timestep) for frame in capture.split("train")}
    for case in cases:
        settings = Train(
            iterations=steps,
            gtstar_probability=0.0,
            density=Density(stop=2 * steps // 3),
            refine_tracking=case.refinement,
        )
        subject, rng = prepare_subject(capture, path, settings, found), np.random.default_rng(0)
        if case.wrong:
            for timestep, parameters in exact.items():
                subject.sequence.set_parameters(timestep, disturbed(parameters, rng))
        surfels, _ = train_surfels(settings, subject)
        avatar = Avatar(surfels, subject.sequence, settings.rig, settings.rotate_harmonics, capture.background)
        yield Measurement(case.name, "distance", "mm", 1e3 * distance(subject.sequence, exact))
        for name, split in (("training frames", "train"), ("held-out frames", "test")):
            yield Measurement(case.name, f"PSNR of {name}", "dB", mean_psnr(avatar, capture, capture.split(split)))


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("--steps", type=int, default=1500)
    task = parser.parse_args()
    with TemporaryDirectory() as folder:
        write_measurements(task.rows, measure(Path(folder), Toy(), task.steps, CASES))


if __name__ == "__main__":
    run(main)
