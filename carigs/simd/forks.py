"""Kernels and tensors in forked processes, as those of `multiprocessing`: they run on one thread.

A fork has none of the threads of its parent, and GNU OpenMP does not know: PyTorch waits for them for ever, and Numba
ends the process ("fork() called from a process already using GNU OpenMP"), which a pool of processes replaces by the
next one. So a forked process starts no loop on several threads. Its results are those of any other number of threads.
"""

from __future__ import annotations

import ctypes
import os
import sys
import threading
from functools import cache

import numba
from llvmlite import binding, ir
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import cpu_target

from carigs.system.fork_server import is_fork_server

_LOOP = "numba_parallel_for"
"""Function that kernels call with a function and its tasks: Numba's threads run them."""
_BYTES, _INTP = ir.IntType(8).as_pointer(), ir.IntType(64)
_forked = ctypes.c_int32(0)
"""1 in a forked process; compiled code reads it."""


def is_forked() -> bool:
    """Whether this process was forked from one whose threads may have run, and so has one thread for kernels.

    Returns:
        False also for jobs of `carigs.system.fork_server`, which runs no kernels itself.
    """
    return bool(_forked.value)


@cache
def start_threads() -> None:
    """Start Numba's threads, and let the loops of forks of this process run without them.

    It has to be called before a kernel with a parallel loop is compiled or loaded.
    """
    if is_forked():  # what OpenMP remembers of the parent's threads belongs to this thread: a new one knows nothing
        starting = threading.Thread(target=numba.get_num_threads)
        starting.start()
        starting.join()
    else:
        numba.get_num_threads()
    with global_compiler_lock:
        binding.add_symbol(_LOOP, _loop_unless_forked(binding.address_of_symbol(_LOOP)))


def _loop_unless_forked(loop: int) -> int:
    """Compile a function that runs all tasks itself in a forked process, and else calls the function at `loop`.

    Returns:
        Its address.
    """
    library = cpu_target.target_context.codegen().create_library("loops in forks")
    module = library.create_ir_module("loops in forks")
    loop_type = ir.FunctionType(ir.VoidType(), [_BYTES] * 5 + [_INTP] * 3)
    function = ir.Function(module, loop_type, "carigs_parallel_for")
    builder = ir.IRBuilder(function.append_basic_block())
    work, *arguments = function.args[:5]
    forked = builder.load(builder.inttoptr(_INTP(ctypes.addressof(_forked)), ir.IntType(32).as_pointer()))
    with builder.if_else(builder.icmp_signed("!=", forked, ir.IntType(32)(0))) as (alone, together):
        with alone:
            work_type = ir.FunctionType(ir.VoidType(), [_BYTES] * 4)
            builder.call(builder.bitcast(work, work_type.as_pointer()), arguments)
        with together:
            builder.call(builder.inttoptr(_INTP(loop), loop_type.as_pointer()), function.args)
    builder.ret_void()
    library.add_ir_module(module)
    library.finalize()
    _libraries.append(library)
    return library.get_pointer_to_function(function.name)


_libraries: list[object] = []
"""Keeps the machine code of functions alive."""


def _after_fork() -> None:
    global_compiler_lock.release()
    if is_fork_server():
        return
    _forked.value = 1
    if torch := sys.modules.get("torch"):
        torch.set_num_threads(1)
    from threadpoolctl import threadpool_limits

    threadpool_limits(1, "openmp")  # for a torch that is imported later


if hasattr(os, "register_at_fork"):
    # No thread compiles during a fork: in the child it would never end, and everybody would wait for it.
    os.register_at_fork(
        before=global_compiler_lock.acquire,
        after_in_parent=global_compiler_lock.release,
        after_in_child=_after_fork,
    )
