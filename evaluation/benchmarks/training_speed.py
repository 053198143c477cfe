"""Parts of a training step (loss, skinning, colours), whole steps per second, and rendered frames per second."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from unittest.mock import patch

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import conv2d

from carigs.head import pose
from carigs.settings import Density, Regions, Train
from carigs.simd.threads import use_threads
from carigs.splat.avatar import Avatar
from carigs.splat.colour.appearance import seen_colour
from carigs.splat.rasterizer import rasterize as rasterizer
from carigs.splat.rasterizer.rasterize import rasterize
from carigs.splat.render import render
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.rig.rig import face_motion
from carigs.splat.rig.skinning import jacobian_blend_skinning
from carigs.splat.surfels.surfels import Surfels, flat_discs
from carigs.splat.training.checkpoint import TrainingState
from carigs.splat.training.initial_surfels.initialization import place
from carigs.splat.training.photometric_loss import photometric_loss
from carigs.splat.training.subject import TrainingSubject
from carigs.splat.training.supervision import Supervision
from carigs.splat.training.trainer import train_surfels
from evaluation.benchmarks.measurement import timing
from evaluation.benchmarks.measurement.kernel_timing import num_threads
from evaluation.benchmarks.measurement.synthetic_scenes import (
    capture_images,
    moving_head,
    portrait,
    scene_name,
    surfels_on_ellipsoid,
)
from evaluation.benchmarks.measurement.timing import Measurement
from evaluation.benchmarks.surfel_pixel_pairs import contributing_pairs

BLOCK = 5
"""Number of consecutive steps with the same number of threads."""
SETTINGS = Train(
    sh_degree=3,
    surfels_per_face=3,
    gtstar_probability=0.0,
    regions=Regions(hair=()),
    # About the sizes and the mean opacity of `synthetic_scenes.surfels_on_ellipsoid`.
    initial_scale=0.21,
    initial_opacity=0.55,
    density=Density(every=0),
)
VARIANTS = {
    ("SH 3",): {},
    ("SH 3", "distortion and normals"): {"distortion_weight": 100.0, "normal_weight": 0.05},
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
        self.count, self.started = 1, timing.wall_seconds()
        self.times: dict[int, list[float]] = {1: [], 2: []}

    def __call__(self, state: TrainingState) -> None:
        """Take the time of a step; change the number of threads after `BLOCK` steps.

        Args:
            state: TrainingState of the training after the step.
        """
        self.times[self.count].append(timing.wall_seconds() - self.started)
        if state.iteration % BLOCK == 0:
            self.count = 3 - self.count
            use_threads(self.count)
        self.started = timing.wall_seconds()

    def seconds(self, count: int) -> float:
        """Median time of a step, without the first quarter, which has no regularizers.

        Args:
            count: Number of threads.

        Returns:
            Wall seconds.
        """
        times = self.times[count]
        return median(times[max(BLOCK, len(times) // 4) :])


def torch_photometric(
    image: Float[Tensor, "3 h w"], target: Float[Tensor, "3 h w"], share: float = 0.2
) -> Float[Tensor, ""]:
    """The loss `photometric_loss` in torch: a separable filter on a stack of all channels and moments.

    Args:
        image: Rendered image.
        target: Target image.
        share: Weight of the SSIM term.

    Returns:
        (1 - share) L1 + share (1 - SSIM).
    """
    offsets = torch.arange(-5, 6)
    taps = torch.exp(-(offsets**2) / (2 * 1.5**2))
    taps = (taps / taps.sum()).expand(15, 1, 1, 11)
    stack = torch.cat([image, target, image * image, target * target, image * target])[None]
    stack = conv2d(conv2d(stack, taps, padding=(0, 5), groups=15), taps.mT, padding=(5, 0), groups=15)
    m, n, xx, yy, xy = stack[0].chunk(5)
    upper = (2 * m * n + 0.01**2) * (2 * (xy - m * n) + 0.03**2)
    lower = (m * m + n * n + 0.01**2) * (xx - m * m + yy - n * n + 0.03**2)
    return (1 - share) * (image - target).abs().mean() + share * (1 - (upper / lower).mean())


def measure_loss(width: int, height: int, repeats: int) -> Iterator[Measurement]:
    """Measure the wall time of L1 + SSIM and its gradient with two threads.

    Images differ in every pixel, or on a head before an equal background.

    Args:
        width: Image width in pixels.
        height: Image height in pixels.
        repeats: Number of rounds.

    Yields:
        Records; references are those of `torch_photometric`.
    """
    generator = torch.Generator().manual_seed(0)
    image = torch.rand((3, height, width), generator=generator, requires_grad=True)
    other = torch.rand((3, height, width), generator=generator)
    with torch.no_grad():
        head = (
            rasterize(
                surfels_on_ellipsoid(2_000, spread=2.0), portrait(width, height), outputs=("colour", "alpha")
            ).alpha
            > 0
        )
        masked = torch.where(head, other, image)
    for name, target in (("everywhere", other), ("on half of the image", masked)):
        in_memory = target.permute(1, 2, 0).contiguous()
        works = {
            # Memory layouts as in training: the image in planes, as rendered, and the target as read from a file.
            "fused": lambda y=in_memory: torch.autograd.grad(photometric_loss(image.permute(1, 2, 0), y), image),
            "torch": lambda y=target: torch.autograd.grad(torch_photometric(image, y), image),
        }
        with num_threads(2):
            times = timing.compare_times(works, repeats)
        case = f"{height}x{width}, 2 threads, images differ {name}"
        yield Measurement(case, "L1 + SSIM", "ms", 1e3 * times["fused"], 1e3 * times["torch"])
        yield Measurement(case, "torch / fused L1 + SSIM", "1", times["torch"] / times["fused"])


def measure_skinning(subdivisions: int, repeats: int) -> Iterator[Measurement]:
    """Measure the CPU time of skinning and of spherical harmonics of degree 3 with one thread.

    Args:
        subdivisions: Fineness of the head.
        repeats: Number of rounds.

    Yields:
        Records; references are those of the scalar kernels in float64.
    """
    sequence = moving_head(subdivisions)
    rig, head = sequence.rig, sequence.head
    motion = face_motion(rig, pose(head, sequence.parameters[2]))
    binding, position, scale, _ = place(SETTINGS, rig)
    surfels = flat_discs(binding, position, scale, 0.5, np.full((len(binding), 3), 0.5), sh_degree=3)
    doubles = {name: value.detach().double().requires_grad_(True) for name, value in surfels.attributes()}
    shade, eye = np.ones((len(rig.faces), 3), np.float32), np.array([0.0, 0.0, 1.0])

    def timed(name: str, function: Callable[..., object], *leaves: Tensor) -> dict[str, float]:
        start = timing.cpu_seconds()
        outputs = function()
        middle = timing.cpu_seconds()
        torch.autograd.grad(outputs, leaves, [torch.ones_like(output) for output in outputs])
        return {f"{name} forward": middle - start, f"{name} backward": timing.cpu_seconds() - middle}

    def measured(surfels: Surfels) -> dict[str, float]:
        leaves = [value for name, value in surfels.attributes() if name not in ("colour", "harmonics")]
        direction = jacobian_blend_skinning(surfels, rig, motion, eye=eye).direction.detach().requires_grad_(True)
        painted = surfels.colour, surfels.harmonics, direction
        skinning = timed("skinning", lambda: jacobian_blend_skinning(surfels, rig, motion, eye=eye), *leaves)
        return skinning | timed("colours", lambda: (seen_colour(*painted, shade, surfels.binding),), *painted)

    works = {"simd": surfels, "scalar": Surfels(**doubles, binding=surfels.binding)}
    with num_threads(1):
        times = timing.median_times_in_turns({name: partial(measured, s) for name, s in works.items()}, repeats)
    for name, value in times["simd"].items():
        case = f"{len(surfels)} surfels, 1 thread, SH 3"
        yield Measurement(case, name, "ms", 1e3 * value, 1e3 * times["scalar"][name])


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
                # Trainings of users have no choice of kernels.
                with patch.dict(rasterizer._KERNELS, {"cpu": rasterizer._KERNELS["scalar"]}):
                    scalar = _steps(settings, sequence, supervision, 3)[1]
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
        surfels, _ = train_surfels(settings, TrainingSubject(sequence, supervision), on_step=timer)
    return surfels, timer


def _measure_rendering(
    surfels: Surfels, sequence: HeadSequence, supervision: Supervision, turns: int
) -> Iterator[Measurement]:
    """Measure rendering alone, of all poses in turn, and the number of contributing pairs."""
    avatar, camera, poses = Avatar(surfels, sequence), supervision.capture.cameras[1], sequence.parameters

    def render_all(count: int, backend: str) -> None:
        with num_threads(count):
            for t in poses:
                avatar.render(t, 0.0, camera, backend=backend)

    works = {key: partial(render_all, *key) for key in itertools.product((1, 2), ("cpu", "scalar"))}
    rates = {key: len(poses) / seconds for key, seconds in timing.compare_times(works, turns).items()}
    for count in (1, 2):
        case = scene_name(len(surfels), camera, count, "SH 3")
        yield Measurement(case, "rendering", "1/s", rates[count, "cpu"], rates[count, "scalar"])
    drawing = render(surfels, sequence.rig, sequence.motion(0, 0.0), camera)
    case = scene_name(len(surfels), camera, 1, "SH 3")
    yield Measurement(case, "contributing pairs", "1", contributing_pairs(drawing.world, camera))
