"""What the surfel engine costs beside plain loops and torch, and how that grows: CSV, and a plot beside it.

python -m evaluation.benchmarks.splat results/benchmark/splat.csv [--quick]

Nothing else should run on the machine meanwhile.  `--quick` only shows that everything can be measured.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor
from torch.nn.functional import conv2d

from carigs.capture import Camera
from carigs.head import pose
from carigs.splat.colour.appearance import seen_colour
from carigs.splat.rasterizer.rasterize import OUTPUTS, WorldSurfels, rasterize
from carigs.splat.rig.rig import face_motion
from carigs.splat.rig.skinning import jacobian_blend_skinning
from carigs.splat.surfels.initialization import place
from carigs.splat.surfels.surfels import Surfels, flat_discs
from carigs.splat.training.photometric_loss import photometric_loss
from evaluation.benchmarks.chart import plot
from evaluation.benchmarks.clocks import (
    KERNELS,
    cpu_seconds,
    in_a_fresh_process,
    in_turns,
    kernel_times,
    race,
    spent,
    threads,
)
from evaluation.benchmarks.measurements import Measurement, write_measurements
from evaluation.benchmarks.pairs import contributing_pairs
from evaluation.benchmarks.scenes import ellipsoid, moving_head, portrait, scene_name
from evaluation.benchmarks.training import SETTINGS, training_rows

COLOURS = ("colour", "alpha")
"""Outputs that a training without geometric terms asks for."""


@dataclass(frozen=True)
class Sizes:
    """How much of everything; images are (width, height)."""

    surfels: int = 50_000
    image: tuple[int, int] = (550, 802)
    repeats: int = 9
    subdivisions: int = 5
    """Of the head that is trained: 3 surfels on each of its 20 * 4^n triangles."""
    turns: int = 10
    """Of five training steps with each number of threads."""
    growing_surfels: tuple[int, ...] = (5_000, 10_000, 20_000, 50_000, 100_000, 200_000, 300_000)
    growing_images: tuple[tuple[int, int], ...] = ((256, 256), (275, 401), (550, 802), (1100, 1604))
    processes: int = 5
    cold: bool = True
    """Whether the kernels are compiled from nothing, too."""


QUICK = Sizes(
    surfels=2_000, image=(110, 160), repeats=2, subdivisions=2, turns=2, growing_surfels=(500, 2_000),
    growing_images=((64, 64), (110, 160)), processes=1, cold=False,
)  # fmt: skip


def gradient_of(surfels: WorldSurfels, camera: Camera, outputs: tuple[str, ...]) -> Callable[[str], object]:
    """A rendering and its gradient, from a fixed random upstream gradient, as a function of the backend."""
    leaves = [surfels.centre, surfels.tangent_u, surfels.tangent_v, surfels.opacity, surfels.colour]
    generator = torch.Generator().manual_seed(0)
    shape = (camera.height, camera.width)
    upstream = [torch.randn(shape + (3,) * (name in ("colour", "normal")), generator=generator) for name in outputs]

    def render_and_pull_back(backend: str) -> object:
        rendering = rasterize(surfels, camera, backend=backend, outputs=outputs)
        return torch.autograd.grad([getattr(rendering, name) for name in outputs], leaves, upstream)

    return render_and_pull_back


def kernel_rows(
    name: str, surfels: WorldSurfels, camera: Camera, outputs: tuple[str, ...], repeats: int
) -> Iterator[Measurement]:
    """CPU time of each kernel with one thread, in all and per contributing pair; references are the plain loops'."""
    work = gradient_of(surfels, camera, outputs)

    def measured(backend: str) -> dict[str, float]:
        with kernel_times(backend) as times:
            call = spent(lambda: work(backend), cpu_seconds)
        return {**times, "all kernels": sum(times.values()), "with torch around them": call}

    with threads(1):
        times = in_turns({backend: partial(measured, backend) for backend in ("cpu", "scalar")}, repeats)
    fast, slow = times["cpu"], times["scalar"]
    case = scene_name(len(surfels.centre), camera, 1, name)
    for kernel in (*KERNELS, "all kernels", "with torch around them"):
        yield Measurement(case, kernel, "ms", 1e3 * fast[kernel], 1e3 * slow[kernel])
    yield Measurement(case, "plain loops / all kernels", "1", slow["all kernels"] / fast["all kernels"])
    pairs = contributing_pairs(surfels, camera)
    yield Measurement(case, "contributing pairs", "1", pairs)
    for kernel in ("forward", "backward"):
        yield Measurement(case, f"{kernel} per pair", "ns", 1e9 * fast[kernel] / pairs, 1e9 * slow[kernel] / pairs)


def torch_photometric(
    image: Float[Tensor, "3 h w"], target: Float[Tensor, "3 h w"], share: float = 0.2
) -> Float[Tensor, ""]:
    """`photometric_loss` in torch, the fastest we know: a separable filter on a stack of all channels and moments."""
    offsets = torch.arange(-5, 6)
    taps = torch.exp(-(offsets**2) / (2 * 1.5**2))
    taps = (taps / taps.sum()).expand(15, 1, 1, 11)
    stack = torch.cat([image, target, image * image, target * target, image * target])[None]
    stack = conv2d(conv2d(stack, taps, padding=(0, 5), groups=15), taps.mT, padding=(5, 0), groups=15)
    m, n, xx, yy, xy = stack[0].chunk(5)
    upper = (2 * m * n + 0.01**2) * (2 * (xy - m * n) + 0.03**2)
    lower = (m * m + n * n + 0.01**2) * (xx - m * m + yy - n * n + 0.03**2)
    return (1 - share) * (image - target).abs().mean() + share * (1 - (upper / lower).mean())


def loss_rows(width: int, height: int, repeats: int) -> Iterator[Measurement]:
    """L1 + SSIM, forward and backward, wall time with two threads; references are torch's.

    Of images that differ in every pixel, and of a head before an equal background.
    """
    generator = torch.Generator().manual_seed(0)
    image = torch.rand((3, height, width), generator=generator, requires_grad=True)
    other = torch.rand((3, height, width), generator=generator)
    with torch.no_grad():
        head = rasterize(ellipsoid(2_000, spread=2.0), portrait(width, height), outputs=COLOURS).alpha > 0
        masked = torch.where(head, other, image)
    for name, target in (("everywhere", other), ("on half of the image", masked)):
        in_memory = target.permute(1, 2, 0).contiguous()
        works = {
            # As the trainer has them: the image's planes from the rasteriser, the target from a file.
            "fused": lambda y=in_memory: torch.autograd.grad(photometric_loss(image.permute(1, 2, 0), y), image),
            "torch": lambda y=target: torch.autograd.grad(torch_photometric(image, y), image),
        }
        with threads(2):
            times = race(works, repeats)
        case = f"{height}x{width}, 2 threads, images differ {name}"
        yield Measurement(case, "L1 + SSIM", "ms", 1e3 * times["fused"], 1e3 * times["torch"])
        yield Measurement(case, "torch / fused L1 + SSIM", "1", times["torch"] / times["fused"])


def skinning_rows(subdivisions: int, repeats: int) -> Iterator[Measurement]:
    """CPU time of skinning and of colours of degree 3 with one thread; references are one by one, in float64."""
    performance = moving_head(subdivisions)
    rig, head = performance.rig, performance.head
    motion = face_motion(rig, pose(head, performance.parameters[2]))
    binding, position, scale = place(SETTINGS, rig, np.zeros(len(rig.faces), bool))
    surfels = flat_discs(binding, position, scale, 0.5, np.full((len(binding), 3), 0.5), sh_degree=3)
    doubles = {name: value.detach().double().requires_grad_(True) for name, value in surfels.attributes()}
    shade, eye = np.ones((len(rig.faces), 3), np.float32), np.array([0.0, 0.0, 1.0])

    def clocked(name: str, function: Callable[..., object], *leaves: Tensor) -> dict[str, float]:
        start = cpu_seconds()
        outputs = function()
        middle = cpu_seconds()
        torch.autograd.grad(outputs, leaves, [torch.ones_like(output) for output in outputs])
        return {f"{name} forward": middle - start, f"{name} backward": cpu_seconds() - middle}

    def measured(surfels: Surfels) -> dict[str, float]:
        leaves = [value for name, value in surfels.attributes() if name not in ("colour", "harmonics")]
        direction = jacobian_blend_skinning(surfels, rig, motion, eye=eye).direction.detach().requires_grad_(True)
        painted = surfels.colour, surfels.harmonics, direction
        return clocked(
            "skinning", lambda: jacobian_blend_skinning(surfels, rig, motion, eye=np.array([0.0, 0.0, 1.0])), *leaves
        ) | clocked("colours", lambda: (seen_colour(*painted, shade, surfels.binding),), *painted)

    works = {"lanes": surfels, "loops": Surfels(**doubles, binding=surfels.binding)}
    with threads(1):
        times = in_turns({name: partial(measured, s) for name, s in works.items()}, repeats)
    for name, value in times["lanes"].items():
        case = f"{len(surfels)} surfels, 1 thread, SH 3"
        yield Measurement(case, name, "ms", 1e3 * value, 1e3 * times["loops"][name])


def scaling_rows(sizes: Sizes) -> Iterator[Measurement]:
    """Wall time of a rendering and its gradient against surfels and pixels; references are the plain loops'."""
    scenes = [(count, sizes.image) for count in sizes.growing_surfels]
    scenes += [(sizes.surfels, image) for image in sizes.growing_images]
    for count, image in dict.fromkeys(scenes):
        camera = portrait(*image)
        work = gradient_of(ellipsoid(count), camera, COLOURS)
        for number in (1, 2):
            with threads(number):
                times = race({name: partial(work, name) for name in ("cpu", "scalar")}, max(sizes.repeats // 3, 1))
            case = scene_name(count, camera, number)
            yield Measurement(case, "forward and backward", "ms", 1e3 * times["cpu"], 1e3 * times["scalar"])


START = """
import json, time, torch
start = time.perf_counter()
from carigs.splat.rasterizer.rasterize import rasterize
imported = time.perf_counter()
from evaluation.benchmarks.scenes import ellipsoid, portrait
surfels, camera = ellipsoid(1000), portrait(64, 64)
ready = time.perf_counter()
image = rasterize(surfels, camera, outputs=("colour", "alpha"))
torch.autograd.grad([image.colour.sum() + image.alpha.sum()], [surfels.centre])
done = time.perf_counter()
print(json.dumps({"import": imported - start, "first rendering and gradient": done - ready}))
"""


def start_rows(processes: int, cold: bool) -> Iterator[Measurement]:
    """Wall time that the rasteriser needs in a fresh process beyond `import torch`: kernels cached, and compiled."""
    runs = [in_a_fresh_process(START) for _ in range(processes)]
    for name in runs[0]:
        yield Measurement("start, kernels cached", name, "s", median(run[name] for run in runs))
    if cold:
        with TemporaryDirectory() as cache:
            times = in_a_fresh_process(START, NUMBA_CACHE_DIR=cache)
        for name, value in times.items():
            yield Measurement("start, nothing cached", name, "s", value)


def measurements(sizes: Sizes) -> Iterator[Measurement]:
    """All rows."""
    camera = portrait(*sizes.image)
    for name, spread, outputs in (("normal", 1.0, COLOURS), ("dense", 2.0, COLOURS), ("geometry", 1.0, OUTPUTS)):
        yield from kernel_rows(name, ellipsoid(sizes.surfels, spread=spread), camera, outputs, sizes.repeats)
    yield from loss_rows(*sizes.image, sizes.repeats)
    yield from skinning_rows(sizes.subdivisions, sizes.repeats)
    yield from training_rows(sizes.subdivisions, *sizes.image, sizes.turns)
    yield from scaling_rows(sizes)
    # Last: the kernels are cached by now.
    yield from start_rows(sizes.processes, sizes.cold)


def benchmark(file: Path, sizes: Sizes) -> None:
    """Measure, write `file` and the plot beside it."""
    rows = []
    for row in measurements(sizes):
        print(f"{row.case}: {row.quantity} {row.value:.4g} {row.unit}", flush=True)
        rows.append(row)
    write_measurements(file, rows)
    plot(file.with_suffix(".png"), rows)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path)
    parser.add_argument("--quick", action="store_true")
    arguments = parser.parse_args()
    benchmark(arguments.file, QUICK if arguments.quick else Sizes())
