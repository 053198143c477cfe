"""Quality against time: trainings of several lengths, the CPU time that each takes, and how close its images are.

Every number of steps is a training of its own: learning rates and density control end with it. CPU time is that of one
thread with compiled kernels; frames are those of the tables, the held-out sequence at level 0 and at gamma.

Example:
    python -m evaluation.benchmarks.quality quality.csv results/toy/toy/gamma=0.25 --steps 500 1000 2000
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from carigs.capture import Capture
from carigs.hair import find_hair
from carigs.simd.threads import use_threads
from carigs.splat.avatar import Avatar
from evaluation.benchmarks.measurement.plots import plot_quality
from evaluation.benchmarks.measurement.study_subject import StudySubject
from evaluation.benchmarks.measurement.timing import Measurement, elapsed, write_measurements
from evaluation.benchmarks.measurement.toy_training import TrainingInputs, psnr_by_region, train_avatar
from evaluation.command_line import csv_parser, run

SHARES = 1 / 8, 1 / 4, 1 / 2, 1
"""Numbers of steps, as shares of those of the study."""
WARM_UP = 10
"""Steps of a training that is not measured: it loads the kernels."""


def _train(study: StudySubject, steps: int) -> Avatar:
    inputs = TrainingInputs(study.capture, study.path, study.hair, study.targets())
    return train_avatar(inputs, study.settings_for(steps))


def measure(folder: Path, variant: str = "alternating", steps: Sequence[int] = ()) -> Iterator[Measurement]:
    """Train with several numbers of steps, on one thread.

    Args:
        folder: Results of the subject at its gamma: `results/STUDY/SUBJECT/gamma=GAMMA`.
        variant: Variant of the study, without GT* frames or with those of `alternating`.
        steps: Numbers of steps; if there are none, `SHARES` of those of the study.

    Yields:
        CPU time of the stage `hair`; and of each training its CPU time, the number of surfels, and the mean PSNR of
        every region over the frames of a level that show it.
    """
    use_threads(1)
    study = StudySubject.load(folder, variant)
    views = {level: study.views(level) for level in (0.0, study.path.gamma_f)}
    for _ in range(2):  # the first time loads the kernels
        capture = Capture.load(folder.parent / "capture.json")
        hair = elapsed(lambda capture=capture: find_hair(study.hair_settings, capture), time.process_time)
    yield Measurement(folder.parent.name, "CPU time of the stage hair", "s", hair)
    _train(study, WARM_UP)
    for number in steps or [round(share * study.train.iterations) for share in SHARES]:
        case, start = f"{folder.parent.name}, {variant}, {number} steps", time.process_time()
        avatar = _train(StudySubject.load(folder, variant), number)
        yield Measurement(case, "CPU time", "s", time.process_time() - start)
        yield Measurement(case, "surfels", "", len(avatar.surfels))
        for level, frames in views.items():
            for region, value in psnr_by_region(avatar, level, frames).items():
                yield Measurement(case, f"PSNR at level {level:g}, {region}", "dB", value)


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("folder", type=Path, help="results/STUDY/SUBJECT/gamma=GAMMA, with hair, targets and truth")
    parser.add_argument("--variant", default="alternating", help="a variant of the study")
    parser.add_argument("--steps", type=int, nargs="+", default=[], metavar="N", help="default: shares of the study's")
    task = parser.parse_args()
    measurements = write_measurements(task.rows, measure(task.folder, task.variant, task.steps))
    plot_quality(task.rows.with_suffix(".png"), measurements)


if __name__ == "__main__":
    run(main)
