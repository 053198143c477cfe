"""Times of the rasterizer's kernels, and number of threads."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from unittest.mock import patch

# Before numba starts its threads: see `carigs.simd.threads`.
import torch  # isort: skip

from carigs.simd.threads import use_threads
from carigs.splat.rasterizer import binning
from carigs.splat.rasterizer import rasterize as rasterizer
from evaluation.benchmarks.measurement.timing import cpu_seconds

KERNELS = ("projection", "binning", "forward", "backward", "projection backward")


@contextmanager
def kernel_times(backend: str) -> Iterator[dict[str, float]]:
    """Time each of `KERNELS` in the last rendering and gradient of the block.

    Args:
        backend: `cpu` or `scalar`.

    Yields:
        CPU seconds by kernel, filled in while the block runs.
    """
    times: dict[str, float] = {}

    def timed(name, kernel):
        def call(*arguments):
            start = cpu_seconds()
            result = kernel(*arguments)
            times[name] = cpu_seconds() - start
            return result

        return call

    names = [name for name in KERNELS if name != "binning"]
    kernels = tuple(timed(*pair) for pair in zip(names, rasterizer._KERNELS[backend], strict=True))
    lists = timed("binning", binning.tile_lists)
    with patch.dict(rasterizer._KERNELS, {backend: kernels}), patch.object(binning, "tile_lists", lists):
        yield times


@contextmanager
def num_threads(count: int) -> Iterator[None]:
    """Run torch and Numba with another number of threads in the block.

    Args:
        count: Number of threads.

    Yields:
        Nothing.
    """
    before = torch.get_num_threads()
    use_threads(count)
    try:
        yield
    finally:
        use_threads(before)
