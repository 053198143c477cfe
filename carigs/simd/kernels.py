"""How kernels are compiled: once, with all that they call; and how their work is spread over threads.

Numba optimises every function by itself, makes machine code of it, and does so again inside each of its callers; a
`prange` goes through this three more times, and infers the types of its body twice.  Here pieces of kernels are only
linked, and `parallel_for` calls the function of a task from one loop in the kernel's own module.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler
from numba.core.compiler_lock import global_compiler_lock
from numba.core.typed_passes import _reload_parfors
from numba.extending import intrinsic

from carigs.simd.kernel_cache import kernel_lock


def kernel(function: Callable | None = None, /, **options: object) -> Callable:
    """A function that Python calls, kept in the cache; processes that need it at the same time wait for the first."""
    if function is None:
        return partial(kernel, **options)
    dispatcher = njit(cache=True, nogil=True, error_model="numpy", no_cfunc_wrapper=True, **options)(function)
    compiled = dispatcher.compile

    def compiled_once(signature: object) -> object:
        # Numba takes this one, too; in the same order everywhere, so that no two threads wait for each other.
        with global_compiler_lock, kernel_lock(f"{function.__module__}.{function.__qualname__}"):
            return compiled(signature)

    dispatcher.compile = compiled_once
    return dispatcher


class _Pieces(JITCodeLibrary):
    """Code that becomes machine code only as a part of what it is linked into."""

    def finalize(self) -> None:
        self._raise_if_finalized()
        for library in dict.fromkeys(self._linking_libraries):
            self._reload_init.update(library._reload_init)
            self._final_module.link_in(library._get_module_for_linking(), preserve=True)
        self._optimize_final_module()
        self._finalized = True


class _PieceCompiler(Compiler):
    def __init__(self, typingctx, targetctx, library, args, return_type, flags, locals):
        library = library or _Pieces(targetctx.codegen(), "pieces")
        super().__init__(typingctx, targetctx, library, args, return_type, flags, locals)
        self.state.targetctx.get_executable = lambda library, fndesc, env: _uncallable()


def _uncallable() -> object:
    """Numba wants a built-in function of its own that Python could call; this one always raises."""
    return [].pop


INLINE = {
    "error_model": "numpy", "no_cpython_wrapper": True, "no_cfunc_wrapper": True, "forceinline": True,
    "pipeline_class": _PieceCompiler, "_nrt": False,
}  # fmt: skip
"""Options of functions that only kernels call.  None stays a function of its own (forward compositing is a sixth
faster, projection a third), and none counts who refers to an array, which LLVM does not always see to be idle: they can
make none."""
INLINE_ALLOC = {**INLINE, "_nrt": True}
"""Of those among them that make arrays: best not in inner loops."""
_BYTES, _INTP = ir.IntType(8).as_pointer(), ir.IntType(64)


@intrinsic
def parallel_for(typingctx, work, count, arguments):
    """work(i, *arguments) for all i in range(count), on Numba's threads; arrays are the way to hand results back.

    An error of one of them is raised when all have ended.
    """
    task = work.get_call_type(typingctx, (types.intp, *arguments), {})

    def codegen(context, builder, signature, values):
        result = work.dispatcher.get_compile_result(task)
        context.active_code_library.add_linking_library(result.library)
        context.active_code_library._reload_init.add(_reload_parfors)
        _reload_parfors()
        given = _folded(context, builder, cgutils.unpack_tuple(builder, values[2]), tuple(arguments), task.args[1:])
        none = cgutils.get_null_value(cgutils.voidptr_t)
        shared = cgutils.pack_struct(builder, [ir.Constant(ir.IntType(32), 0), none, *given])
        place = cgutils.alloca_once_value(builder, shared)
        loop = _loop(context, builder.module, result.fndesc, task, shared.type)
        _parallel_for(builder, loop, values[1], place)
        code, raised = (builder.load(cgutils.gep_inbounds(builder, place, 0, k)) for k in (0, 1))
        conv = context.call_conv
        raised = builder.bitcast(raised, conv._get_excinfo_argument(builder.function).type.pointee)
        status = conv._get_return_status(builder, code, raised)
        with cgutils.if_unlikely(builder, status.is_error):
            conv.return_status_propagate(builder, status)
        return context.get_dummy_value()

    return types.void(work, types.intp, arguments), codegen


def _folded(context, builder, values, kinds, wanted):
    """The values as a function takes them; the last of those may be its `*arguments`."""
    if wanted and isinstance(wanted[-1], (types.StarArgTuple, types.StarArgUniTuple)):
        *wanted, rest = wanted
        n = len(wanted)
        rest = [context.make_tuple(builder, rest, _folded(context, builder, values[n:], kinds[n:], tuple(rest)))]
        return _folded(context, builder, values[:n], kinds[:n], wanted) + rest
    return [context.cast(builder, *parallel_for) for parallel_for in zip(values, kinds, wanted, strict=True)]


def _loop(context, module, work, task, shared):
    """What Numba's threads call: steps a range of tasks."""
    kind = ir.FunctionType(ir.VoidType(), [_BYTES.as_pointer(), _INTP.as_pointer(), _INTP.as_pointer(), _BYTES])
    function = ir.Function(module, kind, module.get_unique_name("parallel_for"))
    function.linkage = "internal"
    first, counts, _, data = function.args
    builder = ir.IRBuilder(function.append_basic_block())
    place = builder.bitcast(data, shared.as_pointer())
    given = [builder.load(cgutils.gep_inbounds(builder, place, 0, k)) for k in range(2, len(shared.elements))]
    start = builder.ptrtoint(builder.load(first), _INTP)
    with cgutils.for_range(builder, builder.load(counts), intp=_INTP) as tasks:
        number = builder.add(start, tasks.index)
        builder.assume(builder.icmp_signed(">=", number, _INTP(0)))  # negative indices count from the end
        status, _ = context.call_internal_no_propagate(builder, work, task, [number, *given])
        with cgutils.if_unlikely(builder, status.is_error):
            builder.store(status.code, cgutils.gep_inbounds(builder, place, 0, 0))
            raised = builder.bitcast(status.excinfoptr, _BYTES)
            builder.store(raised, cgutils.gep_inbounds(builder, place, 0, 1))
    builder.ret_void()
    return function


def _parallel_for(builder, loop, count, place):
    """Numba's thread pool: one array of bytes that begins at address 0 counts the tasks."""
    call = ir.FunctionType(ir.VoidType(), [_BYTES] * 5 + [_INTP] * 3)
    pool = cgutils.get_or_insert_function(builder.module, call, "numba_parallel_for")
    asked = cgutils.get_or_insert_function(builder.module, ir.FunctionType(_INTP, []), "get_num_threads")
    first = cgutils.alloca_once_value(builder, cgutils.get_null_value(_BYTES))
    size, step = cgutils.alloca_once_value(builder, count), cgutils.alloca_once_value(builder, _INTP(1))
    pointers = [builder.bitcast(pointer, _BYTES) for pointer in (loop, first, size, step, place)]
    builder.call(pool, [*pointers, _INTP(0), _INTP(1), builder.call(asked, [])])
