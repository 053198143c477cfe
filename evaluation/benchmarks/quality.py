"""Training to quality: PSNR of frames that training never saw against its time, at several surfel budgets.

python -m evaluation.benchmarks.quality quality.csv SETTINGS.yaml CAPTURE.json PATH.npz --budgets 16000 60000
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

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
from carigs.splat.training.supervision import Supervision
from carigs.splat.training.trainer import train_surfels
from evaluation.metrics.image_quality import psnr

FRAMES = 12
"""Test frames that are compared, evenly over all."""
LOOKS = 8
"""Moments of a run at which they are, closer together at its beginning."""


class Look(NamedTuple):
    """A row: after `step` of `steps`, `seconds` of training (wall time, comparing not counted)."""

    budget: int
    steps: int
    step: int
    seconds: float
    surfels: int
    psnr: float


class Watch:
    """Looks at a run from beside it."""

    def __init__(self, settings: Train, performance: HeadSequence, capture: Capture) -> None:
        self.settings, self.performance, self.capture = settings, performance, capture
        frames = capture.split("test")
        self.frames = [frames[i] for i in np.unique(np.linspace(0, len(frames) - 1, FRAMES).astype(int))]
        self.moments = set(np.geomspace(settings.iterations / 32, settings.iterations, LOOKS).astype(int))
        self.rows: list[Look] = []
        self.seconds, self.started = 0.0, time.perf_counter()

    def __call__(self, state: TrainingState) -> None:
        """Count the time of the step; compare if this is the moment."""
        self.seconds += time.perf_counter() - self.started
        if state.iteration in self.moments:
            steps, budget = self.settings.iterations, self.settings.density.max_surfels
            psnr = self.psnr(Avatar(state.surfels, self.performance, background=self.capture.background))
            row = Look(budget, steps, state.iteration, self.seconds, len(state.surfels), psnr)
            self.rows.append(row)
            print(*(f"{name} {value:.6g}" for name, value in row._asdict().items()), flush=True)
        self.started = time.perf_counter()

    def psnr(self, avatar: Avatar) -> float:
        """Mean over the frames, of images as they would be written: eight bits."""
        values = []
        for frame in self.frames:
            image = avatar.render(frame.timestep, 0.0, self.capture.cameras[frame.camera])
            image = np.rint(np.clip(image, 0, 1) * 255) / 255
            values.append(psnr(image, self.capture.image(frame)))
        return float(np.mean(values))


def looks(
    settings: Train, performance: HeadSequence, capture: Capture, budgets: Sequence[int], steps: Sequence[int]
) -> Iterator[Look]:
    """Rows of a run on real frames alone for each budget and number of steps; surfels multiply for two thirds of it."""
    use_threads(settings.threads)
    for budget, iterations in product(budgets, steps):
        density = replace(settings.density, stop=2 * iterations // 3, max_surfels=budget)
        run = replace(settings, iterations=iterations, gtstar_probability=0.0, density=density)
        watch, supervision = Watch(run, performance, capture), Supervision(capture)
        with TemporaryDirectory() as folder:
            train_surfels(run, performance, supervision, Path(folder) / "checkpoint", watch)
        yield from watch.rows


def plot(file: Path, table: pd.DataFrame) -> None:
    """PSNR against seconds, a line for every run."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7.0, 4.5), dpi=120, layout="constrained")
    FigureCanvasAgg(figure)
    axes: Any = figure.subplots()
    for number, (budget, runs) in enumerate(table.groupby("budget")):
        for style, (steps, run) in zip(("o-", "s--", "^:", "v-."), runs.groupby("steps"), strict=False):
            label = f"at most {budget:,} surfels, {steps:,} steps"
            axes.plot(run.seconds, run.psnr, style, color=f"C{number}", markersize=4, label=label)
    axes.set_xscale("log")
    axes.set_xlabel("seconds of training")
    axes.set_ylabel("PSNR of test frames in dB")
    axes.grid(alpha=0.3, which="both")
    axes.legend(fontsize=8, frameon=False)
    with writing(file) as part:
        figure.savefig(part, metadata={"Software": None})


def main() -> None:
    """Measure, write the rows and the plot beside them."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("file", type=Path, help="CSV to write; the plot goes beside it")
    parser.add_argument("settings", type=Path, help="YAML of the stage `train`, as in a study's folder `settings`")
    parser.add_argument("capture", type=Path)
    parser.add_argument("path", type=Path, help="gamma path of the subject (of any gamma)")
    parser.add_argument("--budgets", type=int, nargs="+", default=[16000, 20000, 60000], metavar="N", help="of surfels")
    parser.add_argument("--steps", type=int, nargs="+", default=[750, 3000])
    parser.add_argument("--threads", type=int, default=2)
    arguments = parser.parse_args()
    settings = replace(load_settings("train", arguments.settings), threads=arguments.threads)
    capture, path = Capture.load(arguments.capture), GammaPath.load(arguments.path)
    rows = looks(settings, head_sequence(capture, path), capture, arguments.budgets, arguments.steps)
    table = pd.DataFrame(rows)
    with writing(arguments.file) as part:
        table.round({"seconds": 2, "psnr": 3}).to_csv(part, index=False)
    plot(arguments.file.with_suffix(".png"), table)


if __name__ == "__main__":
    main()
