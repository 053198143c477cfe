"""Time of a training step that refines the tracking, and of one that does not, on the procedural subject.

Example:
    python -m evaluation.benchmarks.refined_step refined_step.csv
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from unittest.mock import patch

from carigs.capture import Capture
from carigs.exaggeration import GammaPath
from carigs.hair import find_hair
from carigs.settings import Density, Hair, RefineTracking, Toy, Train
from carigs.splat.training.checkpoint import TrainingState
from carigs.splat.training.subject import prepare_subject
from carigs.splat.training.trainer import train_surfels
from carigs.splat.training.training_step import StepInputs
from evaluation.benchmarks.measurement.kernel_timing import num_threads
from evaluation.benchmarks.measurement.timing import Measurement, wall_seconds, write_measurements
from evaluation.benchmarks.measurement.toy_frames import write_subject
from evaluation.command_line import csv_parser, run

SETTINGS = Train(
    iterations=2000,
    gtstar_probability=0.0,
    density=Density(every=0),
    refine_tracking=RefineTracking(until=0.5),
)
BLOCK = 100
"""Number of consecutive steps of one kind. The first step with a frame whose head was refined poses it again."""


class TurnsTimer:
    """Observer of a training whose blocks of steps refine and do not refine, by turns.

    Args:
        block: Number of steps of a block.
    """

    def __init__(self, block: int) -> None:
        self.block, self.started = block, wall_seconds()
        self.seconds: dict[bool, list[float]] = {True: [], False: []}
        """Time of each step, of those that refine and of the others."""

    def refines(self, i: int) -> bool:
        """Whether a step refines.

        Args:
            i: The step.

        Returns:
            Whether its block does.
        """
        return (i // self.block) % 2 == 1

    def __call__(self, state: TrainingState) -> None:
        """Take the time of a step.

        Args:
            state: State of the training after the step.
        """
        self.seconds[self.refines(state.iteration - 1)].append(wall_seconds() - self.started)
        self.started = wall_seconds()

    def median(self, refines: bool) -> float:
        """Median time of a step, without the first block: images are read, buffers are allocated.

        Args:
            refines: Kind of the steps.

        Returns:
            Wall seconds.
        """
        return median(self.seconds[refines][self.block :])


def measure(folder: Path, toy: Toy, settings: Train, block: int) -> Iterator[Measurement]:
    """Measure with one thread.

    Args:
        folder: Empty folder for the capture.
        toy: Settings of the subject.
        settings: Settings of the training, at least four blocks of steps.
        block: Number of consecutive steps of one kind.

    Yields:
        Median times, and their ratio.
    """
    write_subject(folder, toy)
    capture, path = Capture.load(folder / "capture.json"), GammaPath.load(folder / "path.npz")
    subject, timer = prepare_subject(capture, path, settings, find_hair(Hair(), capture)), TurnsTimer(block)
    with num_threads(1), patch.object(StepInputs, "refines_tracking", lambda _, i: timer.refines(i)):
        surfels, _ = train_surfels(settings, subject, on_step=timer)
    case = f"{len(surfels)} surfels, {len(capture.model.faces)} triangles, 1 thread"
    refined, plain = timer.median(True), timer.median(False)
    yield Measurement(case, "step that refines", "ms", 1e3 * refined, 1e3 * plain)
    yield Measurement(case, "refines / does not", "1", refined / plain)


def benchmark(file: Path, toy: Toy | None = None, settings: Train = SETTINGS, block: int = BLOCK) -> None:
    """Measure, and write the records.

    Args:
        file: CSV file to write.
        toy: Settings of the subject; None for the defaults.
        settings: Settings of the training.
        block: Number of consecutive steps of one kind.
    """
    with TemporaryDirectory() as folder:
        write_measurements(file, measure(Path(folder), toy or Toy(), settings, block))


def main() -> None:
    """Run the benchmark from the command line."""
    benchmark(csv_parser(__doc__).parse_args().rows)


if __name__ == "__main__":
    run(main)
