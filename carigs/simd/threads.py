"""The number of threads of torch and Numba. They share one OpenMP pool, if torch is imported first."""

from __future__ import annotations

import torch  # isort: skip
import numba

from carigs.simd.kernel_cache import announce_compilation

numba.config.THREADING_LAYER_PRIORITY = ["omp", "tbb", "workqueue"]


def use_threads(count: int) -> None:
    """Set the number of threads of torch and Numba.

    Args:
        count: Number of threads; Numba uses at most as many as it was started with.
    """
    announce_compilation()
    # Numba first: when it starts its threads, it sets OpenMP's number to all of them, for torch too.
    numba.set_num_threads(min(count, numba.config.NUMBA_NUM_THREADS))
    torch.set_num_threads(count)
