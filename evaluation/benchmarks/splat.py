"""Time of the surfel engine beside its scalar reference ("plain loops") and torch, and its growth with the scene.

Nothing else should run on the machine meanwhile.

Example:
    python -m evaluation.benchmarks.splat results/benchmark/splat.csv
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

import torch

from carigs.capture import Camera
from carigs.splat.rasterizer.rasterize import OUTPUTS, WorldSurfels, rasterize
from evaluation.benchmarks.measurement import timing
from evaluation.benchmarks.measurement.kernel_timing import KERNELS, kernel_times, num_threads
from evaluation.benchmarks.measurement.plots import plot_splat
from evaluation.benchmarks.measurement.synthetic_scenes import portrait, scene_name, surfels_on_ellipsoid
from evaluation.benchmarks.measurement.timing import Measurement
from evaluation.benchmarks.surfel_pixel_pairs import contributing_pairs
from evaluation.benchmarks.training_speed import measure_loss, measure_skinning, measure_training
from evaluation.command_line import csv_parser, run

COLOURS = ("colour", "alpha")
"""Outputs that a training without geometric regularizers asks for."""


@dataclass(frozen=True)
class Sizes:
    """Sizes of the scenes and numbers of repetitions; images are (width, height)."""

    surfels: int = 50_000
    image: tuple[int, int] = (550, 802)
    repeats: int = 9
    subdivisions: int = 5
    """Fineness n of the trained head: 3 surfels on each of its 20 * 4^n triangles."""
    turns: int = 10
    """Number of turns of five training steps with each number of threads."""
    growing_surfels: tuple[int, ...] = (5_000, 10_000, 20_000, 50_000, 100_000, 200_000, 300_000)
    growing_images: tuple[tuple[int, int], ...] = ((256, 256), (275, 401), (550, 802), (1100, 1604))
    processes: int = 5
    cold: bool = True
    """Whether to time a start with an empty kernel cache, too."""


QUICK = Sizes(
    surfels=2_000, image=(110, 160), repeats=2, subdivisions=2, turns=2, growing_surfels=(500, 2_000),
    growing_images=((64, 64), (110, 160)), processes=1, cold=False,
)  # fmt: skip


def rendering_and_gradient(surfels: WorldSurfels, camera: Camera, outputs: tuple[str, ...]) -> Callable[[str], object]:
    """Function that renders and pulls back a fixed random gradient.

    Args:
        surfels: Surfels.
        camera: Camera.
        outputs: Names of the outputs to render.

    Returns:
        Function of the backend's name.
    """
    leaves = [surfels.centre, surfels.tangent_u, surfels.tangent_v, surfels.opacity, surfels.colour]
    generator = torch.Generator().manual_seed(0)
    shape = (camera.height, camera.width)
    upstream = [torch.randn(shape + (3,) * (name in ("colour", "normal")), generator=generator) for name in outputs]

    def render_and_pull_back(backend: str) -> object:
        rendering = rasterize(surfels, camera, backend=backend, outputs=outputs)
        return torch.autograd.grad([getattr(rendering, name) for name in outputs], leaves, upstream)

    return render_and_pull_back


def measure_kernels(
    name: str, surfels: WorldSurfels, camera: Camera, outputs: tuple[str, ...], repeats: int
) -> Iterator[Measurement]:
    """Measure the CPU time of each kernel with one thread, in total and per contributing pair.

    Args:
        name: Name of the scene.
        surfels: Surfels.
        camera: Camera.
        outputs: Names of the outputs to render.
        repeats: Number of rounds.

    Yields:
        Records; references are those of the scalar kernels.
    """
    work = rendering_and_gradient(surfels, camera, outputs)

    def measured(backend: str) -> dict[str, float]:
        with kernel_times(backend) as times:
            call = timing.elapsed(lambda: work(backend), timing.cpu_seconds)
        return {**times, "all kernels": sum(times.values()), "with torch around them": call}

    works = {backend: partial(measured, backend) for backend in ("cpu", "scalar")}
    with num_threads(1):
        times = timing.median_times_in_turns(works, repeats)
    fast, slow = times["cpu"], times["scalar"]
    case = scene_name(len(surfels.centre), camera, 1, name)
    for kernel in (*KERNELS, "all kernels", "with torch around them"):
        yield Measurement(case, kernel, "ms", 1e3 * fast[kernel], 1e3 * slow[kernel])
    yield Measurement(case, "plain loops / all kernels", "1", slow["all kernels"] / fast["all kernels"])
    pairs = contributing_pairs(surfels, camera)
    yield Measurement(case, "contributing pairs", "1", pairs)
    for kernel in ("forward", "backward"):
        yield Measurement(case, f"{kernel} per pair", "ns", 1e9 * fast[kernel] / pairs, 1e9 * slow[kernel] / pairs)


def measure_scaling(sizes: Sizes) -> Iterator[Measurement]:
    """Measure the wall time of a rendering and its gradient against the numbers of surfels and pixels.

    Args:
        sizes: Sizes of the scenes.

    Yields:
        Records; references are those of the scalar kernels.
    """
    scenes = [(count, sizes.image) for count in sizes.growing_surfels]
    scenes += [(sizes.surfels, image) for image in sizes.growing_images]
    for count, image in dict.fromkeys(scenes):
        camera = portrait(*image)
        work = rendering_and_gradient(surfels_on_ellipsoid(count), camera, COLOURS)
        for number in (1, 2):
            with num_threads(number):
                works = {backend: partial(work, backend) for backend in ("cpu", "scalar")}
                times = timing.compare_times(works, max(sizes.repeats // 3, 1))
            case = scene_name(count, camera, number)
            yield Measurement(case, "forward and backward", "ms", 1e3 * times["cpu"], 1e3 * times["scalar"])


START = """
import json, time, torch
start = time.perf_counter()
from carigs.splat.rasterizer.rasterize import rasterize
imported = time.perf_counter()
from evaluation.benchmarks.measurement.synthetic_scenes import portrait, surfels_on_ellipsoid
surfels, camera = surfels_on_ellipsoid(1000), portrait(64, 64)
ready = time.perf_counter()
image = rasterize(surfels, camera, outputs=("colour", "alpha"))
torch.autograd.grad([image.colour.sum() + image.alpha.sum()], [surfels.centre])
done = time.perf_counter()
print(json.dumps({"import": imported - start, "first rendering and gradient": done - ready}))
"""


def measure_start(processes: int, cold: bool) -> Iterator[Measurement]:
    """Measure the wall time that the rasterizer needs in a fresh process beyond `import torch`.

    Args:
        processes: Number of processes.
        cold: Whether to time an empty kernel cache, too.

    Yields:
        Records.
    """
    runs = [timing.run_in_fresh_process(START) for _ in range(processes)]
    for name in runs[0]:
        yield Measurement("start, kernels cached", name, "s", median(run[name] for run in runs))
    if cold:
        with TemporaryDirectory() as cache:
            times = timing.run_in_fresh_process(START, NUMBA_CACHE_DIR=cache)
        for name, value in times.items():
            yield Measurement("start, nothing cached", name, "s", value)


def measurements(sizes: Sizes) -> Iterator[Measurement]:
    """Take all measurements.

    Args:
        sizes: Sizes of the scenes.

    Yields:
        Records.
    """
    camera = portrait(*sizes.image)
    geometry = (*COLOURS, "depth", "normal")
    scenes = (
        ("normal", 1.0, COLOURS),
        ("dense", 2.0, COLOURS),
        ("geometry", 1.0, geometry),
        ("distortion", 1.0, OUTPUTS),
    )
    for name, spread, outputs in scenes:
        yield from measure_kernels(
            name, surfels_on_ellipsoid(sizes.surfels, spread=spread), camera, outputs, sizes.repeats
        )
    yield from measure_loss(*sizes.image, sizes.repeats)
    yield from measure_skinning(sizes.subdivisions, sizes.repeats)
    yield from measure_training(sizes.subdivisions, *sizes.image, sizes.turns)
    yield from measure_scaling(sizes)
    # Last, when the kernels are cached.
    yield from measure_start(sizes.processes, sizes.cold)


def benchmark(file: Path, sizes: Sizes) -> None:
    """Measure, and write the records and their plot.

    Args:
        file: CSV file to write; the plot goes beside it.
        sizes: Sizes of the scenes.
    """
    plot_splat(file.with_suffix(".png"), timing.write_measurements(file, measurements(sizes)), KERNELS)


def main() -> None:
    """Run the benchmark from the command line."""
    parser = csv_parser(__doc__)
    parser.add_argument("--quick", action="store_true", help="tiny scenes, to test the benchmark itself")
    arguments = parser.parse_args()
    benchmark(arguments.rows, QUICK if arguments.quick else Sizes())


if __name__ == "__main__":
    run(main)
