"""Training to quality: PSNR of held-out frames against training time, at several surfel budgets.

Example:
    python -m evaluation.benchmarks.quality quality.csv SETTINGS.yaml CAPTURE.json PATH.npz --budgets 16000 60000
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import NamedTuple

import numpy as np
import pandas as pd

from carigs.capture import Capture
from carigs.config import load_settings
from carigs.exaggeration import GammaPath
from carigs.files import writing
from carigs.settings import Train
from carigs.simd.threads import use_threads
from carigs.splat.avatar import Avatar
from carigs.splat.rig.head_sequence import HeadSequence, head_sequence
from carigs.splat.training.checkpoint import TrainingState
from carigs.splat.training.subject import Subject
from carigs.splat.training.supervision import Supervision
from carigs.splat.training.trainer import train_surfels
from evaluation.benchmarks.plots import plot_quality
from evaluation.benchmarks.timing import wall_seconds
from evaluation.command_line import csv_parser, run
from evaluation.metrics.image_quality import psnr

FRAMES = 12
"""Number of test frames that are compared, evenly over all."""
EVALUATIONS = 8
"""Number of evaluations during a run, closer together at its beginning."""


class Evaluation(NamedTuple):
    """Quality after `step` of `steps` of a run."""

    budget: int
    steps: int
    step: int
    seconds: float
    """Wall time of the training so far, without evaluations."""
    surfels: int
    psnr: float


class QualityMonitor:
    """Evaluates a training run at chosen steps.

    Args:
        settings: Settings of the run.
        sequence: Head motion of the capture.
        capture: The capture, with its test frames.
    """

    def __init__(self, settings: Train, sequence: HeadSequence, capture: Capture) -> None:
        self.settings, self.sequence, self.capture = settings, sequence, capture
        frames = capture.split("test")
        self.frames = [frames[i] for i in np.unique(np.linspace(0, len(frames) - 1, FRAMES).astype(int))]
        self.steps = set(np.geomspace(settings.iterations / 32, settings.iterations, EVALUATIONS).astype(int))
        self.evaluations: list[Evaluation] = []
        self.seconds, self.started = 0.0, wall_seconds()

    def __call__(self, state: TrainingState) -> None:
        """Add the time of a step; evaluate if it is a chosen one.

        Args:
            state: TrainingState of the training after the step.
        """
        self.seconds += wall_seconds() - self.started
        if state.iteration in self.steps:
            quality = self.psnr(Avatar(state.surfels, self.sequence, background=self.capture.background))
            run = self.settings.density.max_surfels, self.settings.iterations, state.iteration
            evaluation = Evaluation(*run, self.seconds, len(state.surfels), quality)
            self.evaluations.append(evaluation)
            print(*(f"{name} {value:.6g}" for name, value in evaluation._asdict().items()), flush=True)
        self.started = wall_seconds()

    def psnr(self, avatar: Avatar) -> float:
        """Mean PSNR over the frames, of images rounded to eight bits.

        Args:
            avatar: The avatar.

        Returns:
            PSNR in dB.
        """
        values = []
        for frame in self.frames:
            image = avatar.render(frame.timestep, 0.0, self.capture.camera(frame))
            values.append(psnr(np.rint(np.clip(image, 0, 1) * 255) / 255, self.capture.image(frame)))
        return float(np.mean(values))


def evaluate_runs(
    settings: Train, sequence: HeadSequence, capture: Capture, budgets: Sequence[int], steps: Sequence[int]
) -> Iterator[Evaluation]:
    """Train on real frames alone, once for each budget and number of steps; density control ends after two thirds.

    Args:
        settings: Settings of the stage `train`.
        sequence: Head motion of the capture.
        capture: The capture.
        budgets: Largest numbers of surfels.
        steps: Numbers of steps.

    Yields:
        Evaluations during each run.
    """
    use_threads(settings.threads)
    for budget, iterations in product(budgets, steps):
        density = replace(settings.density, stop=2 * iterations // 3, max_surfels=budget)
        run = replace(settings, iterations=iterations, gtstar_probability=0.0, density=density)
        monitor, supervision = QualityMonitor(run, sequence, capture), Supervision(capture)
        with TemporaryDirectory() as folder:
            train_surfels(run, Subject(sequence, supervision), Path(folder) / "checkpoint", monitor)
        yield from monitor.evaluations


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("settings", type=Path, help="YAML of the stage `train`, as in a study's folder `settings`")
    parser.add_argument("capture", type=Path)
    parser.add_argument("path", type=Path, help="gamma path of the subject (of any gamma)")
    parser.add_argument("--budgets", type=int, nargs="+", default=[16000, 20000, 60000], metavar="N", help="of surfels")
    parser.add_argument("--steps", type=int, nargs="+", default=[750, 3000])
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    settings = replace(load_settings("train", arguments.settings), threads=arguments.threads)
    capture, path = Capture.load(arguments.capture), GammaPath.load(arguments.path)
    runs = evaluate_runs(settings, head_sequence(capture, path), capture, arguments.budgets, arguments.steps)
    table = pd.DataFrame(runs)
    with writing(arguments.rows) as part:
        table.round({"seconds": 2, "psnr": 3}).to_csv(part, index=False)
    plot_quality(arguments.rows.with_suffix(".png"), table)


if __name__ == "__main__":
    run(main)
