"""Whole training steps per second, and frames per second of what they make."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from unittest.mock import patch

from carigs.settings import Density, Train
from carigs.simd.threads import use_threads
from carigs.splat.avatar import Avatar
from carigs.splat.render import render
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.surfels.surfels import Surfels
from carigs.splat.training import trainer
from carigs.splat.training.supervision import Supervision
from evaluation.benchmarks.clocks import spent, threads, wall_seconds
from evaluation.benchmarks.measurements import Measurement
from evaluation.benchmarks.pairs import contributing_pairs
from evaluation.benchmarks.scenes import filmed, moving_head, scene_name

BLOCK = 5
"""Steps in a row with the same number of threads."""
SETTINGS = Train(
    sh_degree=3,
    surfels_per_face=3,
    gtstar_probability=0.0,
    hair_regions=(),
    # About the sizes and the mean opacity of `scenes.ellipsoid`.
    initial_scale=0.21,
    initial_opacity=0.55,
    density=Density(every=0),
)
VARIANTS = {
    ("SH 3",): {},
    ("SH 3", "distortion and normals"): {"distortion_weight": 100.0, "normal_weight": 0.05, "regularize_from": 0},
    ("SH 3", "first surfels by default"): {
        "initial_scale": Train().initial_scale,
        "initial_opacity": Train().initial_opacity,
    },
}


class StepClock:
    """Stands where the trainer shows its progress: times each step, and every few changes the number of threads.

    A run's result does not depend on the latter, so one run can take turns.
    """

    def __init__(self) -> None:
        self.count, self.started = 1, 0.0
        self.times: dict[int, list[float]] = {1: [], 2: []}

    @contextmanager
    def progress(self, *_: object) -> Iterator[Callable[..., None]]:
        """As `carigs.splat.training.progress.progress`."""
        with threads(self.count):
            self.started = wall_seconds()
            yield self._report

    def _report(self, done: int, **_: float) -> None:
        self.times[self.count].append(wall_seconds() - self.started)
        if done % BLOCK == 0:
            self.count = 3 - self.count
            use_threads(self.count)
        self.started = wall_seconds()

    def seconds(self, count: int) -> float:
        """Median of the steps with that many threads, without those of the first turn."""
        return median(self.times[count][BLOCK:])


def training_rows(subdivisions: int, width: int, height: int, turns: int) -> Iterator[Measurement]:
    """Steps and frames per second with 1 and 2 threads, each in `turns` turns; references are those of plain loops."""
    performance = moving_head(subdivisions)
    with TemporaryDirectory() as folder:
        supervision = filmed(performance, Path(folder), width, height)
        for number, (name, changes) in enumerate(VARIANTS.items()):
            settings = replace(SETTINGS, **changes)
            surfels, fast = _steps(settings, performance, supervision, turns)
            plain = None
            if number == 0:
                plain = _steps(replace(settings, backend="scalar"), performance, supervision, 3)[1]
                yield from _frame_rows(surfels, performance, supervision, turns)
            for count in (1, 2):
                reference = plain and 1 / plain.seconds(count)
                case = scene_name(len(surfels), supervision.capture.cameras[1], count, *name)
                yield Measurement(case, "training step", "1/s", 1 / fast.seconds(count), reference)


def _steps(
    settings: Train, performance: HeadSequence, supervision: Supervision, turns: int
) -> tuple[Surfels, StepClock]:
    """Train with the trainer's own steps."""
    clock = StepClock()
    settings = replace(settings, iterations=2 * turns * BLOCK)
    with patch.object(trainer, "progress", clock.progress):
        surfels, _ = trainer.train_surfels(settings, performance, supervision, supervision.capture.root / "checkpoint")
    return surfels, clock


def _frame_rows(
    surfels: Surfels, performance: HeadSequence, supervision: Supervision, turns: int
) -> Iterator[Measurement]:
    """Rendering alone, of the poses in turn; and how much there is to render."""
    avatar = Avatar(surfels, performance)
    camera = supervision.capture.cameras[1]
    poses = itertools.cycle(performance.parameters)
    times: dict[tuple[int, str], list[float]] = {key: [] for key in itertools.product((1, 2), ("cpu", "scalar"))}
    for _ in range(turns):
        for (count, backend), measured in times.items():
            with threads(count):
                measured += [
                    spent(lambda b=backend: avatar.render(next(poses), 0.0, camera, backend=b), wall_seconds)
                    for _ in range(BLOCK)
                ]
    rates = {key: 1 / median(measured[BLOCK:]) for key, measured in times.items()}
    for count in (1, 2):
        case = scene_name(len(surfels), camera, count, "SH 3")
        yield Measurement(case, "rendering", "1/s", rates[count, "cpu"], rates[count, "scalar"])
    drawing = render(surfels, performance.rig, performance.motion(0, 0.0), camera)
    case = scene_name(len(surfels), camera, 1, "SH 3")
    yield Measurement(case, "contributing pairs", "1", contributing_pairs(drawing.world, camera))
