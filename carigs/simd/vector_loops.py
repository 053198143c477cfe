"""Parallel loops over elements, sixteen at a time."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

from numba.extending import overload

from carigs.simd.kernels import INLINE_ALLOC, parallel_for
from carigs.simd.vectors import WIDTH, simd_inline_alloc

PART_SIZE = 1024
"""Elements of one task."""


def parallel_for_vectors(work: Callable, count: int, arguments: tuple, scratch: Callable | None = None) -> None:
    """Call `work(i, *arguments)` for i = 0, 16, 32, ... below `count`, spread over Numba's threads.

    The last i is count - 16: the last sixteen elements overlap those before, so that there is no remainder. Kernels
    only can call it.

    Args:
        work: Function compiled with `simd_inline` that processes the elements i to i + 15.
        count: Number of elements, at least sixteen.
        arguments: Further arguments of `work`, the same for all calls.
        scratch: Function compiled with `simd_inline_alloc` that allocates a tuple of arrays: the last arguments of
            `work`. Calls that share them follow one another.

    Raises:
        Exception: An error of one of the calls, after all calls have ended.
    """
    raise NotImplementedError("only compiled kernels can call parallel_for_vectors")


@overload(parallel_for_vectors, jit_options=INLINE_ALLOC)
def _overload_parallel_for_vectors(work, count, arguments, scratch=None):
    part = _part(work.dispatcher, getattr(scratch, "dispatcher", _no_scratch))

    def loop(work, count, arguments, scratch=None):
        parallel_for(part, (count + PART_SIZE - 1) // PART_SIZE, (count, arguments))

    return loop


@simd_inline_alloc
def _no_scratch():
    return ()


@cache
def _part(work, scratch):
    """The task of one part of the elements."""

    @simd_inline_alloc
    def run_part(part, count, arguments):
        arrays = scratch()
        for start in range(part * PART_SIZE, min((part + 1) * PART_SIZE, count), WIDTH):
            work(min(start, count - WIDTH), *arguments, *arrays)

    return run_part
