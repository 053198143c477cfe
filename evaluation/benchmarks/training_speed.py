"""Training steps per second, and rendered frames per second."""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from carigs.settings import Density, Train
from carigs.simd.threads import use_threads
from carigs.splat.avatar import Avatar
from carigs.splat.render import render
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.surfels.surfels import Surfels
from carigs.splat.training.checkpoint import State
from carigs.splat.training.supervision import Supervision
from carigs.splat.training.trainer import train_surfels
from evaluation.benchmarks.kernel_timing import num_threads
from evaluation.benchmarks.measurement import Measurement
from evaluation.benchmarks.surfel_pixel_pairs import contributing_pairs
from evaluation.benchmarks.synthetic_scenes import capture_images, moving_head, scene_name
from evaluation.benchmarks.timing import elapsed, wall_seconds

BLOCK = 5
"""Number of consecutive steps with the same number of threads."""
SETTINGS = Train(
    sh_degree=3,
    surfels_per_face=3,
    gtstar_probability=0.0,
    hair_regions=(),
    # About the sizes and the mean opacity of `synthetic_scenes.ellipsoid`.
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


class StepTimer:
    """Observer of a training that times each step, and alternates between 1 and 2 threads.

    The result of a training does not depend on the number of threads, so one run serves both.
    """

    def __init__(self) -> None:
        self.count, self.started = 1, wall_seconds()
        self.times: dict[int, list[float]] = {1: [], 2: []}

    def __call__(self, state: State) -> None:
        """Take the time of a step; change the number of threads after `BLOCK` steps.

        Args:
            state: State of the training after the step.
        """
        self.times[self.count].append(wall_seconds() - self.started)
        if state.iteration % BLOCK == 0:
            self.count = 3 - self.count
            use_threads(self.count)
        self.started = wall_seconds()

    def seconds(self, count: int) -> float:
        """Median time of a step, without the first turn.

        Args:
            count: Number of threads.

        Returns:
            Wall seconds.
        """
        return median(self.times[count][BLOCK:])


def measure_training(subdivisions: int, width: int, height: int, turns: int) -> Iterator[Measurement]:
    """Measure steps and frames per second with 1 and 2 threads.

    Args:
        subdivisions: Fineness of the head.
        width: Image width in pixels.
        height: Image height in pixels.
        turns: Number of turns of `BLOCK` steps with each number of threads.

    Yields:
        Records; references are those of the scalar kernels.
    """
    sequence = moving_head(subdivisions)
    with TemporaryDirectory() as folder:
        supervision = capture_images(sequence, Path(folder), width, height)
        for number, (name, changes) in enumerate(VARIANTS.items()):
            settings = replace(SETTINGS, **changes)
            surfels, fast = _steps(settings, sequence, supervision, turns)
            scalar = None
            if number == 0:
                scalar = _steps(replace(settings, backend="scalar"), sequence, supervision, 3)[1]
                yield from _measure_rendering(surfels, sequence, supervision, turns)
            for count in (1, 2):
                reference = scalar and 1 / scalar.seconds(count)
                case = scene_name(len(surfels), supervision.capture.cameras[1], count, *name)
                yield Measurement(case, "training step", "1/s", 1 / fast.seconds(count), reference)


def _steps(settings: Train, sequence: HeadSequence, supervision: Supervision, turns: int) -> tuple[Surfels, StepTimer]:
    """Time the steps of a training."""
    timer = StepTimer()
    settings = replace(settings, iterations=2 * turns * BLOCK)
    with num_threads(1):
        surfels, _ = train_surfels(settings, sequence, supervision, supervision.capture.root / "checkpoint", timer)
    return surfels, timer


def _measure_rendering(
    surfels: Surfels, sequence: HeadSequence, supervision: Supervision, turns: int
) -> Iterator[Measurement]:
    """Measure rendering alone, of the poses in turn, and the number of contributing pairs."""
    avatar = Avatar(surfels, sequence)
    camera = supervision.capture.cameras[1]
    poses = itertools.cycle(sequence.parameters)
    times: dict[tuple[int, str], list[float]] = {key: [] for key in itertools.product((1, 2), ("cpu", "scalar"))}
    for _ in range(turns):
        for (count, backend), measured in times.items():
            with num_threads(count):
                measured += [
                    elapsed(lambda b=backend: avatar.render(next(poses), 0.0, camera, backend=b), wall_seconds)
                    for _ in range(BLOCK)
                ]
    rates = {key: 1 / median(measured[BLOCK:]) for key, measured in times.items()}
    for count in (1, 2):
        case = scene_name(len(surfels), camera, count, "SH 3")
        yield Measurement(case, "rendering", "1/s", rates[count, "cpu"], rates[count, "scalar"])
    drawing = render(surfels, sequence.rig, sequence.motion(0, 0.0), camera)
    case = scene_name(len(surfels), camera, 1, "SH 3")
    yield Measurement(case, "contributing pairs", "1", contributing_pairs(drawing.world, camera))
