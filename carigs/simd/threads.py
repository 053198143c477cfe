"""The number of threads of torch and Numba. They share one OpenMP pool, if torch is imported first."""

from __future__ import annotations

import torch  # isort: skip
import numba

from carigs.simd.forks import is_forked, start_threads
from carigs.simd.kernel_cache import announce_compilation
from carigs.system.fork_server import share_of_cores

numba.config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]
MOST_THREADS = 8
"""Most threads that idle cores add up to: the kernels of small images have too little work for more."""


def use_threads(count: int) -> None:
    """Set the number of threads of torch and Numba.

    Args:
        count: Number of threads; Numba uses at most as many as it was started with, a forked process one.
    """
    announce_compilation()
    count = 1 if is_forked() else count
    start_threads()  # sets OpenMP's number to all of them, for torch too
    numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))
    torch.set_num_threads(count)


def use_idle_cores(least: int) -> None:
    """Give Numba the cores of the run that no other job uses; a long job calls this again and again.

    Args:
        least: Number of threads that the job has in any case.
    """
    count = min(max(least, min(share_of_cores(), MOST_THREADS)), numba.config.NUMBA_NUM_THREADS)
    if count != numba.get_num_threads():
        numba.set_num_threads(count)
