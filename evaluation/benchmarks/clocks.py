"""How time is taken: in turns with what it is compared to, kernel by kernel, and in a fresh process."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from statistics import median
from unittest.mock import patch

# Before numba starts its threads: see `carigs.simd.threads`.
import torch  # isort: skip
import numba

from carigs.simd.threads import use_threads
from carigs.splat.rasterizer import binning
from carigs.splat.rasterizer import rasterize as rasterizer

KERNELS = ("projection", "binning", "forward", "backward", "projection backward")

# With one thread the calling one does all the work: its CPU time leaves out what else runs on the machine.
cpu_seconds = time.thread_time
wall_seconds = time.perf_counter


def spent(work: Callable[[], object], clock: Callable[[], float]) -> float:
    """Seconds that one call takes."""
    start = clock()
    work()
    return clock() - start


def in_turns(works: Mapping[str, Callable[[], Mapping[str, float]]], repeats: int) -> dict[str, dict[str, float]]:
    """Medians of the times that each work reports by name; all works take turns, after a first round to warm up."""
    rounds = [{key: work() for key, work in works.items()} for _ in range(repeats + 1)][1:]
    return {key: {name: median(r[key][name] for r in rounds) for name in rounds[0][key]} for key in works}


def race(
    works: Mapping[str, Callable[[], object]], repeats: int, clock: Callable[[], float] = wall_seconds
) -> dict[str, float]:
    """`in_turns` for works that are timed as a whole."""
    timed = {name: lambda work=work: {"": spent(work, clock)} for name, work in works.items()}
    return {name: times[""] for name, times in in_turns(timed, repeats).items()}


@contextmanager
def kernel_times(backend: str) -> Iterator[dict[str, float]]:
    """CPU seconds of each of `KERNELS` in the last rendering and gradient within, taken where they are called."""
    times: dict[str, float] = {}

    def clocked(name, kernel):
        def call(*arguments):
            start = cpu_seconds()
            result = kernel(*arguments)
            times[name] = cpu_seconds() - start
            return result

        return call

    names = [name for name in KERNELS if name != "binning"]
    kernels = tuple(clocked(*pair) for pair in zip(names, rasterizer._KERNELS[backend], strict=True))
    lists = clocked("binning", binning.tile_lists)
    with patch.dict(rasterizer._KERNELS, {backend: kernels}), patch.object(binning, "tile_lists", lists):
        yield times


@contextmanager
def threads(count: int) -> Iterator[None]:
    """Torch and Numba with `count` threads."""
    before = numba.get_num_threads(), torch.get_num_threads()
    use_threads(count)
    try:
        yield
    finally:
        numba.set_num_threads(before[0])
        torch.set_num_threads(before[1])


def in_a_fresh_process(code: str, **environment: str) -> dict[str, float]:
    """What the code prints: seconds by name, as JSON."""
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, **environment}, check=True, capture_output=True, text=True
    )
    return json.loads(done.stdout.splitlines()[-1])
