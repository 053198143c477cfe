"""Images per second: one frame after the other, of 20 000 to 200 000 surfels."""

from __future__ import annotations

import time
from collections.abc import Iterator
from statistics import median

import torch

from carigs.splat.rasterizer.interface import WorldSurfels
from carigs.splat.rasterizer.rasterize import rasterize
from evaluation.benchmarks.gpu.figures import Figure, Task
from evaluation.benchmarks.measurement.synthetic_scenes import portrait, surfels_on_ellipsoid

COUNTS = 20_000, 60_000, 200_000
SIZES = (550, 802), (1100, 1604)
"""Width and height of the paper's images, and twice that."""
WARM_UP, REPEATS = 10, 100
SLOW_REPEATS = 3
"""Images of backends without kernels of their own for the device."""


def measure(task: Task) -> Iterator[Figure]:
    """Render without and with gradients.

    Args:
        task: The device.

    Yields:
        Images per second of colour alone; milliseconds of forward and backward pass; largest memory in use.
    """
    cuda = task.cuda
    backend, repeats = ("cuda", REPEATS) if cuda else ("cpu", SLOW_REPEATS)
    for width, height in SIZES:
        camera = portrait(width, height)
        for count in COUNTS:
            world = surfels_on_ellipsoid(count)
            leaves = [value.detach().to(task.device).requires_grad_() for value in vars(world).values()]
            surfels = WorldSurfels(*leaves)
            weights = torch.rand(height, width, 3, device=task.device)
            if cuda:
                torch.cuda.reset_peak_memory_stats()

            def image(surfels: WorldSurfels = surfels, camera=camera) -> torch.Tensor:
                return rasterize(surfels, camera, backend=backend, outputs=("colour",)).colour

            def frame(image=image) -> None:
                with torch.no_grad():
                    image()

            def step(image=image, weights=weights, leaves=leaves) -> None:
                torch.autograd.grad((image() * weights).sum(), leaves)

            case = f"{count} surfels, {height}x{width}, {backend}"
            yield Figure(case, "rendering", 1 / _seconds(frame, repeats, cuda), "1/s")
            yield Figure(case, "forward and backward pass", 1e3 * _seconds(step, repeats, cuda), "ms")
            if cuda:
                yield Figure(case, "memory", torch.cuda.max_memory_allocated() / 2**20, "MiB")


def _seconds(work, repeats: int, cuda: bool) -> float:
    """Median time of a call, each ended before the next one begins."""
    times = []
    for i in range(-min(WARM_UP, repeats), repeats):
        if cuda:
            torch.cuda.synchronize()
        start = time.perf_counter()
        work()
        if cuda:
            torch.cuda.synchronize()
        if i >= 0:
            times.append(time.perf_counter() - start)
    return median(times)
