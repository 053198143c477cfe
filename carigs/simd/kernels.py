"""Compilation of Numba kernels, and parallel loops inside them.

A kernel is a function that Python calls, decorated with `kernel`. Functions that only kernels call are decorated with
`numba.njit(**INLINE)`, or one of the decorators of `carigs.simd.vectors`.

This module needs Numba's public interface only and works with every supported version. For the versions in
`LINKED_NUMBA`, `carigs.simd.linked_kernels` replaces `INLINE`, `INLINE_ALLOC` and `parallel_for` by versions that
compile about twice as fast. The environment variable CARIGS_PLAIN_NUMBA=1 keeps the public interface for those, too.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from functools import partial

import numba
from numba import njit, prange, types
from numba.core.compiler_lock import global_compiler_lock
from numba.extending import overload

from carigs.simd.forks import start_threads
from carigs.simd.kernel_cache import kernel_lock
from carigs.simd.kernel_files import KernelFiles

__all__ = ["INLINE", "INLINE_ALLOC", "LINKED_NUMBA", "kernel", "parallel_for"]

LINKED_NUMBA = ((0, 63), (0, 64), (0, 65), (0, 66), (0, 67), (0, 68))
"""Minor versions of Numba that `carigs.simd.linked_kernels` was tested with. It depends on Numba's private classes."""

INLINE = {"error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "forceinline": True}
"""Options of `numba.njit` for functions that only kernels call. Always inlined: calls would make forward compositing a
sixth slower and projection a third."""
INLINE_ALLOC = INLINE
"""The same for functions that allocate arrays; not for inner loops, where counting references is slow."""
LINKED = numba.version_info.short in LINKED_NUMBA and not os.environ.get("CARIGS_PLAIN_NUMBA")
"""Whether `carigs.simd.linked_kernels` is used."""


def kernel(function: Callable | None = None, /, **options: object) -> Callable:
    """Compile a function that Python calls, and keep its machine code on disk.

    Processes that need the same kernel at the same time wait for the first one to compile it.

    Args:
        function: Function to compile. If absent, a decorator is returned.
        **options: Further options of `numba.njit`.

    Returns:
        The compiled function, which releases the interpreter's lock while it runs.
    """
    if function is None:
        return partial(kernel, **options)
    dispatcher = njit(nogil=True, error_model="numpy", no_cfunc_wrapper=True, **options)(function)
    dispatcher._cache = files = KernelFiles(function)
    compile_here = dispatcher.compile

    def compile_once(signature: object) -> object:
        # Numba's lock first, as everywhere, so that no two threads wait for each other.
        with global_compiler_lock, kernel_lock(files.name):
            if not LINKED or options.get("parallel"):  # linked kernels know themselves whether they have loops
                start_threads()
            return compile_here(signature)

    dispatcher.compile = compile_once
    return dispatcher


def parallel_for(work: Callable, count: int, arguments: tuple) -> None:
    """Call `work(i, *arguments)` for all i in range(count), spread over Numba's threads.

    Kernels only can call it.

    Args:
        work: Function compiled with the options `INLINE` or `INLINE_ALLOC`. It returns nothing: results are written to
            arrays among its arguments.
        count: Number of calls.
        arguments: Further arguments of `work`, the same for all calls.

    Raises:
        Exception: An error of one of the calls, after all calls have ended.

    Example:
        >>> @njit(**INLINE)
        ... def double(i, values):
        ...     values[i] *= 2
        >>> @kernel
        ... def double_all(values):
        ...     parallel_for(double, len(values), (values,))
    """
    raise NotImplementedError("only compiled kernels can call parallel_for")


# Inlined, so that no reference to the Python object `work` remains in the kernel: Numba would not cache it.
@overload(parallel_for, jit_options={"parallel": True, "nogil": True, "error_model": "numpy", "forceinline": True})
def _overload_parallel_for(work, count, arguments):
    # prange takes tuples, but no tuples in tuples: it gets all numbers and arrays in one.
    leaves = _leaves("arguments", arguments)
    numbered = iter(range(len(leaves)))
    names = {"__name__": __name__, "work": work.dispatcher}
    nested = [_nested(element, numbered, names) for element in arguments]
    flatten = njit(eval(f"lambda arguments: ({', '.join(leaves)},)", names))
    run = njit(eval(f"lambda i, flat: work({', '.join(['i', *nested])})", names))

    @njit(error_model="numpy")
    def number_if_failed(i, flat):
        try:
            run(i, flat)
        except Exception:
            return i + 1
        return 0

    def loop(work, count, arguments):
        flat = flatten(arguments)
        failed = 0
        for i in prange(count):
            failed = max(failed, number_if_failed(i, flat))
        if failed:  # prange drops errors: raise this one again
            run(failed - 1, flat)

    return loop


def _leaves(name: str, kind: types.Type) -> list[str]:
    """Expressions of all elements of a nested tuple that are no tuples themselves."""
    if not isinstance(kind, types.BaseTuple):
        return [name]
    return [leaf for k, element in enumerate(kind) for leaf in _leaves(f"{name}[{k}]", element)]


def _nested(kind: types.Type, numbered: Iterator[int], names: dict[str, object]) -> str:
    """Expression of a nested tuple of the next elements of `flat`; classes of named tuples are added to `names`."""
    if not isinstance(kind, types.BaseTuple):
        return f"flat[{next(numbered)}]"
    elements = "".join(f"{_nested(element, numbered, names)}, " for element in kind)
    if not isinstance(kind, types.BaseNamedTuple):
        return f"({elements})"
    names[kind.instance_class.__name__] = kind.instance_class
    return f"{kind.instance_class.__name__}({elements})"


if LINKED:
    from carigs.simd.linked_kernels import INLINE, INLINE_ALLOC, parallel_for
