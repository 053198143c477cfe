"""Compilation of gsplat's kernels, and the first call of one."""

from __future__ import annotations

import time
from collections.abc import Iterator

import torch

from carigs.errors import SettingsError
from carigs.splat.rasterizer.rasterize import rasterize
from evaluation.benchmarks.gpu.figures import Figure, Task
from evaluation.benchmarks.measurement.synthetic_scenes import portrait, surfels_on_ellipsoid


def measure(task: Task) -> Iterator[Figure]:
    """Compile and load the kernels.

    Args:
        task: The device.

    Yields:
        Seconds of the first image, with compilation, and of the second one.

    Raises:
        SettingsError: On a device without CUDA: there is nothing to compile.
    """
    if not task.cuda:
        raise SettingsError("only CUDA devices have kernels to compile")
    surfels, camera = surfels_on_ellipsoid(1000), portrait(64, 64)
    for name in ("first image, kernels compiled", "second image"):
        start = time.perf_counter()
        rasterize(surfels, camera, backend="cuda").colour.sum().backward()
        torch.cuda.synchronize()
        yield Figure("gsplat", name, time.perf_counter() - start, "s")
