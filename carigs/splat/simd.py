"""Sixteen float32 lanes as one Numba value, so that a kernel's arithmetic is vector code by construction.

`lanes` is LLVM's <16 x float>, `mask` its <16 x i1>.  Values live inside compiled functions only.  Operators + - * /,
comparisons and & work between lanes, and with scalars on the right or left; comparisons with NaN are false.  Processors
with narrower registers get the same code split by LLVM.  Loads and stores take flat arrays and check nothing: an array
that is stored to needs as many spare elements at its end as the last store may overhang.
"""

from __future__ import annotations

import operator

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

WIDTH = 16
_FLOAT, _INT = ir.FloatType(), ir.IntType(32)
_VECTOR, _INTS, _BITS = (ir.VectorType(element, WIDTH) for element in (_FLOAT, _INT, ir.IntType(1)))
_QUAD = ir.VectorType(_FLOAT, 4)

# Neither nnan nor ninf: lanes that are masked later may hold inf and NaN, and comparisons must then be false.
FASTMATH = {"contract", "nsz", "arcp", "reassoc", "afn"}
_FLAGS = tuple(sorted(FASTMATH))


class _Lanes(types.Type):
    def __init__(self):
        super().__init__(name="lanes")


class _Mask(types.Type):
    def __init__(self):
        super().__init__(name="mask")


lanes, mask = _Lanes(), _Mask()


@register_model(_Lanes)
class _LanesModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, _VECTOR)


@register_model(_Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, _BITS)


def _constant(values, element=_FLOAT):
    values = list(values)
    return ir.Constant(ir.VectorType(element, len(values)), values)


def _shuffle(builder, a, b, index):
    return builder.shuffle_vector(a, b, _constant(index, _INT))


def _call(builder, name, result, *values):
    kind = ir.FunctionType(result, [value.type for value in values])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, name), values)


def _unary(result, build):
    """Intrinsic of one value of lanes."""

    @intrinsic
    def function(typingctx, a):
        return result(lanes), lambda context, builder, signature, values: build(builder, values[0])

    return function


def _binary(argument, result, build):
    """Intrinsic of two values of the same type."""

    @intrinsic
    def function(typingctx, a, b):
        return result(argument, argument), lambda context, builder, signature, values: build(builder, *values)

    return function


def _operator(symbols, result, build):
    """Give `symbols` a meaning for lanes with lanes and with scalars."""
    function = _binary(lanes, result, build)

    def choose(a, b):
        if a == lanes and b == lanes:
            return lambda a, b: function(a, b)
        if a == lanes and isinstance(b, types.Float):
            return lambda a, b: function(a, splat(np.float32(b)))
        if b == lanes and isinstance(a, types.Float):
            return lambda a, b: function(splat(np.float32(a)), b)
        return None

    for symbol in symbols:
        overload(symbol)(choose)


@intrinsic
def splat(typingctx, scalar):
    """A scalar in all lanes."""

    def codegen(context, builder, signature, values):
        one = builder.insert_element(ir.Constant(_VECTOR, ir.Undefined), values[0], ir.Constant(_INT, 0))
        return _shuffle(builder, one, one, [0] * WIDTH)

    return lanes(types.float32), codegen


_operator((operator.add, operator.iadd), lanes, lambda builder, a, b: builder.fadd(a, b, flags=_FLAGS))
_operator((operator.sub, operator.isub), lanes, lambda builder, a, b: builder.fsub(a, b, flags=_FLAGS))
_operator((operator.mul,), lanes, lambda builder, a, b: builder.fmul(a, b, flags=_FLAGS))
_operator((operator.truediv,), lanes, lambda builder, a, b: builder.fdiv(a, b, flags=_FLAGS))
_operator((operator.lt,), mask, lambda builder, a, b: builder.fcmp_ordered("<", a, b))
_operator((operator.le,), mask, lambda builder, a, b: builder.fcmp_ordered("<=", a, b))
_operator((operator.gt,), mask, lambda builder, a, b: builder.fcmp_ordered(">", a, b))
_operator((operator.ge,), mask, lambda builder, a, b: builder.fcmp_ordered(">=", a, b))

_and = _binary(mask, mask, lambda builder, a, b: builder.and_(a, b))


@overload(operator.and_)
def _choose_and(a, b):
    return (lambda a, b: _and(a, b)) if a == mask and b == mask else None


# Compare and select rather than LLVM's min and max: which operand a NaN yields is then settled (the second).
smaller = _binary(lanes, lanes, lambda builder, a, b: builder.select(builder.fcmp_ordered("<", a, b), a, b))
larger = _binary(lanes, lanes, lambda builder, a, b: builder.select(builder.fcmp_ordered(">", a, b), a, b))
absolute = _unary(lanes, lambda builder, a: _call(builder, "llvm.fabs.v16f32", _VECTOR, a))
_floor = _unary(lanes, lambda builder, a: _call(builder, "llvm.floor.v16f32", _VECTOR, a))


def _reduction(name, start):
    def build(builder, a):
        values = (a,) if start is None else (ir.Constant(_FLOAT, start), a)
        kind = ir.FunctionType(_FLOAT, [value.type for value in values])
        function = cgutils.get_or_insert_function(builder.module, kind, name)
        # Without reassoc, sums are a chain of scalar additions.
        return builder.call(function, values, fastmath=_FLAGS if start is not None else (*_FLAGS, "nnan"))

    return _unary(types.float32, build)


total = _reduction("llvm.vector.reduce.fadd.v16f32", -0.0)
largest = _reduction("llvm.vector.reduce.fmax.v16f32", None)


@intrinsic
def select(typingctx, condition, a, b):
    """a where the condition holds, else b."""
    return lanes(mask, lanes, lanes), lambda context, builder, signature, values: builder.select(*values)


@intrinsic
def columns(typingctx):
    """0 0 0 0 1 1 1 1 2 ..: a lane's column in a block of 4 x 4 pixels."""
    return lanes(), lambda context, builder, signature, values: _constant(i // 4 for i in range(WIDTH))


@intrinsic
def rows(typingctx):
    """0 1 2 3 0 1 2 ..: a lane's row in a block of 4 x 4 pixels."""
    return lanes(), lambda context, builder, signature, values: _constant(i % 4 for i in range(WIDTH))


@intrinsic
def _times_power(typingctx, a, whole):
    """a * 2^whole for whole-numbered lanes, by adding to the exponent's bits."""

    def codegen(context, builder, signature, values):
        shift = builder.shl(builder.fptosi(values[1], _INTS), _constant([23] * WIDTH, _INT))
        return builder.bitcast(builder.add(builder.bitcast(values[0], _INTS), shift), _VECTOR)

    return lanes(lanes, lanes), codegen


# Minimax in relative error on [0, 1].
_C0, _C1, _C2, _C3, _C4, _C5 = (
    np.float32(c) for c in (0.99999993, 0.69315307, 0.24015362, 0.055826318, 0.0089893401, 0.0018775767)
)


# For functions that are called from kernels only: nothing is compiled for calls from Python or C.
inner = njit(fastmath=FASTMATH, error_model="numpy", no_cpython_wrapper=True, no_cfunc_wrapper=True)


@inner
def exp2(x):
    """2^x for lanes within (-126, 128): relative error 1.6e-7."""
    whole = _floor(x)
    f = x - whole
    return _times_power(((((f * _C5 + _C4) * f + _C3) * f + _C2) * f + _C1) * f + _C0, whole)


def _address(context, builder, signature, values):
    data = context.make_array(signature.args[0])(context, builder, value=values[0]).data
    return builder.gep(data, [values[1]])


@intrinsic
def load(typingctx, array, index):
    """Sixteen consecutive elements."""

    def codegen(context, builder, signature, values):
        address = builder.bitcast(_address(context, builder, signature, values), _VECTOR.as_pointer())
        return builder.load(address, align=4)

    return lanes(array, types.intp), codegen


@intrinsic
def store(typingctx, array, index, value):
    """To sixteen consecutive elements."""

    def codegen(context, builder, signature, values):
        address = builder.bitcast(_address(context, builder, signature, values), _VECTOR.as_pointer())
        builder.store(values[2], address, align=4)
        return context.get_dummy_value()

    return types.void(array, types.intp, lanes), codegen


# Between four rows of four (memory) and lanes (columns first): its own inverse.
_TRANSPOSE = [4 * (i % 4) + i // 4 for i in range(WIDTH)]


@intrinsic
def load_block(typingctx, array, index, stride):
    """A block of 4 x 4 pixels from four rows of an image."""

    def codegen(context, builder, signature, values):
        quads = []
        for _ in range(4):
            address = builder.bitcast(_address(context, builder, signature, values), _QUAD.as_pointer())
            quads.append(builder.load(address, align=4))
            values = (values[0], builder.add(values[1], values[2]), values[2])
        top, bottom = (_shuffle(builder, quads[i], quads[i + 1], range(8)) for i in (0, 2))
        both = _shuffle(builder, top, bottom, range(WIDTH))
        return _shuffle(builder, both, both, _TRANSPOSE)

    return lanes(array, types.intp, types.intp), codegen


@intrinsic
def store_block(typingctx, array, index, stride, value):
    """A block of 4 x 4 pixels to four rows of an image."""

    def codegen(context, builder, signature, values):
        array, index, stride, value = values
        by_rows = _shuffle(builder, value, value, _TRANSPOSE)
        for row in range(4):
            quad = _shuffle(builder, by_rows, by_rows, range(4 * row, 4 * row + 4))
            address = _address(context, builder, signature, (array, index))
            builder.store(quad, builder.bitcast(address, _QUAD.as_pointer()), align=4)
            index = builder.add(index, stride)
        return context.get_dummy_value()

    return types.void(array, types.intp, types.intp, lanes), codegen


@intrinsic
def peek(typingctx, array, index):
    """array[index] of a flat array without Python's treatment of negative indices."""

    def codegen(context, builder, signature, values):
        return builder.load(_address(context, builder, signature, values))

    return array.dtype(array, types.intp), codegen


@intrinsic
def poke(typingctx, array, index, value):
    """array[index] = value, likewise."""

    def codegen(context, builder, signature, values):
        builder.store(values[2], _address(context, builder, signature, values))
        return context.get_dummy_value()

    return types.void(array, types.intp, array.dtype), codegen


def _prefetch(write):
    @intrinsic
    def function(typingctx, array, index):
        def codegen(context, builder, signature, values):
            byte = ir.IntType(8).as_pointer()
            address = builder.bitcast(_address(context, builder, signature, values), byte)
            hints = [ir.Constant(_INT, hint) for hint in (write, 3, 1)]  # locality 3: all caches; 1: data
            _call(builder, "llvm.prefetch.p0", ir.VoidType(), address, *hints)
            return context.get_dummy_value()

        return types.void(array, types.intp), codegen

    return function


prefetch, prefetch_to_write = _prefetch(0), _prefetch(1)


@intrinsic
def claim(typingctx, counter, index):
    """counter[index], which is increased by one for the next to ask: atomic."""

    def codegen(context, builder, signature, values):
        address = _address(context, builder, signature, values)
        one = ir.Constant(ir.IntType(64), 1)
        return builder.atomic_rmw("add", address, one, "monotonic")

    return types.int64(counter, types.intp), codegen


@intrinsic
def totals(typingctx, a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p):  # noqa: E741
    """The sixteen values' sums over their lanes, as lanes: a tree of shuffles and additions shared by all."""

    def codegen(context, builder, signature, values):
        values, half = list(values), WIDTH // 2
        while half:
            # Values hold groups of 2 half partial sums; two values merge into one with groups half as long.
            low = [i for i in range(2 * WIDTH) if not i & half]
            high = [i + half for i in low]
            values = [
                builder.fadd(_shuffle(builder, x, y, low), _shuffle(builder, x, y, high), flags=_FLAGS)
                for x, y in zip(values[::2], values[1::2], strict=True)
            ]
            half //= 2
        return values[0]

    return lanes(*[lanes] * WIDTH), codegen
