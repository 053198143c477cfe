"""Time of a training step that refines the tracking, and of one that does not, on the procedural subject.

Example:
    python -m evaluation.benchmarks.refined_step refined_step.csv
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from carigs.capture import Capture
from carigs.exaggeration import GammaPath
from carigs.hair import find_hair
from carigs.settings import Density, Hair, RefineTracking, Toy, Train
from carigs.splat.rig.head_sequence import head_sequence
from carigs.splat.training.checkpoint import TrainingState
from carigs.splat.training.hair_surfels import prepare_hair
from carigs.splat.training.supervision import Supervision
from carigs.splat.training.trainer import train_surfels
from evaluation.benchmarks.kernel_timing import num_threads
from evaluation.benchmarks.timing import Measurement, wall_seconds, write_measurements
from evaluation.benchmarks.toy_frames import write_subject
from evaluation.command_line import csv_parser, run

SETTINGS = Train(
    iterations=600,
    gtstar_probability=0.0,
    density=Density(every=0),
    refine_tracking=RefineTracking(enabled=True, until=0.5),
)
"""The first half of the steps refines."""
RUNS = 4
WARM_UP = 50
"""First steps of each half that are not counted: images are read, buffers are allocated."""


class HalvesTimer:
    """Observer of a training that times each step.

    Args:
        half: Number of steps in the first half.
    """

    def __init__(self, half: int) -> None:
        self.half, self.started = half, wall_seconds()
        self.refined: list[float] = []
        self.plain: list[float] = []

    def __call__(self, state: TrainingState) -> None:
        """Take the time of a step.

        Args:
            state: State of the training after the step.
        """
        times = self.refined if state.iteration <= self.half else self.plain
        times.append(wall_seconds() - self.started)
        self.started = wall_seconds()


def measure(folder: Path, toy: Toy, settings: Train, runs: int, warm_up: int) -> Iterator[Measurement]:
    """Measure with one thread; steps of both kinds alternate in runs of the same training.

    Args:
        folder: Empty folder for the capture.
        toy: Settings of the subject.
        settings: Settings of the training; half of its steps refine.
        runs: Number of trainings.
        warm_up: First steps of each half that are not counted.

    Yields:
        Median times of all trainings, and their ratio.
    """
    write_subject(folder, toy)
    capture, path = Capture.load(folder / "capture.json"), GammaPath.load(folder / "path.npz")
    found, scalp = find_hair(Hair(), capture), capture.model.face_region(*settings.hair_regions)
    refined, plain, ratios, case = [], [], [], ""
    for _ in range(runs):
        sequence, timer = head_sequence(capture, path), HalvesTimer(settings.iterations // 2)
        hair, supervision = prepare_hair(found, scalp, sequence, settings), Supervision(capture)
        with num_threads(1), TemporaryDirectory() as checkpoints:
            surfels, _ = train_surfels(settings, sequence, supervision, Path(checkpoints) / "c", timer, hair)
        refined += timer.refined[warm_up:]
        plain += timer.plain[warm_up:]
        ratios.append(median(timer.refined[warm_up:]) / median(timer.plain[warm_up:]))
        case = f"{len(surfels)} surfels, {len(capture.model.faces)} triangles, 1 thread"
    yield Measurement(case, "step that refines", "ms", 1e3 * median(refined), 1e3 * median(plain))
    yield Measurement(case, "refines / does not", "1", median(refined) / median(plain))
    yield Measurement(case, "refines / does not, largest of the trainings", "1", max(ratios))


def benchmark(
    file: Path, toy: Toy | None = None, settings: Train = SETTINGS, runs: int = RUNS, warm_up: int = WARM_UP
) -> None:
    """Measure, and write the records.

    Args:
        file: CSV file to write.
        toy: Settings of the subject; None for the defaults.
        settings: Settings of the training.
        runs: Number of trainings.
        warm_up: First steps of each half that are not counted.
    """
    with TemporaryDirectory() as folder:
        write_measurements(file, measure(Path(folder), toy or Toy(), settings, runs, warm_up))


def main() -> None:
    """Run the benchmark from the command line."""
    benchmark(csv_parser(__doc__).parse_args().rows)


if __name__ == "__main__":
    run(main)
