"""Functions of the vectors of `simd`.

`sqrt`, `exp`, `log2`, `floor`, `absolute`, `minimum`, `maximum` and `select` take vectors and scalars alike: a formula
written with them once serves plain loops in float64 and vector loops.
"""

from __future__ import annotations

import math

import numpy as np
from llvmlite import ir
from numba import types
from numba.extending import intrinsic, overload

from carigs.simd.kernels import INLINE
from carigs.simd.vectors import (
    FLAGS,
    FLOAT,
    INT,
    MASKS,
    WIDE,
    WIDTH,
    binary,
    broadcast,
    broadcast_wide,
    call,
    constant,
    lanes,
    one_argument,
    shuffle,
    simd_inline,
    two_arguments,
    unary,
    wide,
)


def _llvm(function):
    """LLVM's `function` of one vector, for both kinds."""
    return {
        v: unary(v, v, lambda builder, a, n=f"llvm.{function}.{suffix}": call(builder, n, a.type, a))
        for v, suffix in ((lanes, "v16f32"), (wide, "v8f64"))
    }


def sqrt(x):
    """Square root."""
    return math.sqrt(x)


def absolute(x):
    """|x|."""
    return abs(x)


def floor(x):
    """The largest whole number that is not above x, as a float."""
    return math.floor(x)


one_argument(sqrt, _llvm("sqrt"), lambda a: math.sqrt(a))
one_argument(absolute, _llvm("fabs"), lambda a: abs(a))
one_argument(floor, _llvm("floor"), lambda a: np.floor(a))


def minimum(a, b):
    """A if a < b, else b: also where one is NaN."""
    return a if a < b else b


def maximum(a, b):
    """A if a > b, else b: also where one is NaN."""
    return a if a > b else b


def _choice(sign):
    # Compare and select rather than LLVM's min and max: which operand a NaN yields is then settled.
    return lambda builder, a, b: builder.select(builder.fcmp_ordered(sign, a, b), a, b)


two_arguments((minimum,), {v: binary(v, v, _choice("<")) for v in (lanes, wide)}, lambda a, b: a if a < b else b)
two_arguments((maximum,), {v: binary(v, v, _choice(">")) for v in (lanes, wide)}, lambda a, b: a if a > b else b)


def select(condition, a, b):
    """A where the condition holds, else b."""
    return a if condition else b


def _selection(vector):
    @intrinsic
    def function(typingctx, condition, a, b):
        result = vector(MASKS[vector], vector, vector)
        return result, lambda context, builder, signature, values: builder.select(*values)

    return function


_SELECT = {MASKS[v]: (v, _selection(v)) for v in (lanes, wide)}


@overload(select, jit_options=INLINE)
def _choose_select(condition, a, b):
    if condition not in _SELECT:
        return lambda condition, a, b: a if condition else b
    vector, function = _SELECT[condition]
    spread, kind = (broadcast, np.float32) if vector == lanes else (broadcast_wide, np.float64)
    if a == vector and b == vector:
        return lambda condition, a, b: function(condition, a, b)
    if a == vector:
        return lambda condition, a, b: function(condition, a, spread(kind(b)))
    if b == vector:
        return lambda condition, a, b: function(condition, spread(kind(a)), b)
    return lambda condition, a, b: function(condition, spread(kind(a)), spread(kind(b)))


@intrinsic
def columns(typingctx):
    """0 0 0 0 1 1 1 1 2 ..: a lane's column in a block of 4 x 4 pixels."""
    return lanes(), lambda context, builder, signature, values: constant(i // 4 for i in range(WIDTH))


@intrinsic
def rows(typingctx):
    """0 1 2 3 0 1 2 ..: a lane's row in a block of 4 x 4 pixels."""
    return lanes(), lambda context, builder, signature, values: constant(i % 4 for i in range(WIDTH))


@intrinsic
def halves(typingctx, a):
    """Lanes as two wide vectors, the first eight and the last."""

    def codegen(context, builder, signature, values):
        parts = [shuffle(builder, values[0], values[0], range(at, at + WIDE)) for at in (0, WIDE)]
        return context.make_tuple(builder, signature.return_type, [builder.fpext(p, wide.llvm) for p in parts])

    return types.UniTuple(wide, 2)(lanes), codegen


@intrinsic
def joined(typingctx, a, b):
    """Two wide vectors as lanes, rounded."""

    def codegen(context, builder, signature, values):
        a, b = (builder.fptrunc(value, ir.VectorType(FLOAT, WIDE)) for value in values)
        return shuffle(builder, a, b, range(WIDTH))

    return lanes(wide, wide), codegen


@intrinsic
def whole_bits(typingctx, a):
    """Whole-numbered lanes as 32-bit integers, kept as the floats of the same bits: to be stored in integer arrays."""

    def codegen(context, builder, signature, values):
        return builder.bitcast(builder.fptosi(values[0], ir.VectorType(INT, WIDTH)), lanes.llvm)

    return lanes(lanes), codegen


@intrinsic
def _times_power(typingctx, a, whole):
    """A * 2^whole for whole-numbered lanes, by adding to the exponent's bits."""

    def codegen(context, builder, signature, values):
        ints = ir.VectorType(INT, WIDTH)
        shift = builder.shl(builder.fptosi(values[1], ints), constant([23] * WIDTH, INT))
        return builder.bitcast(builder.add(builder.bitcast(values[0], ints), shift), lanes.llvm)

    return lanes(lanes, lanes), codegen


# Minimax in relative error on [0, 1].
_C0, _C1, _C2, _C3, _C4, _C5 = (
    np.float32(c) for c in (0.99999993, 0.69315307, 0.24015362, 0.055826318, 0.0089893401, 0.0018775767)
)


@simd_inline
def exp2(x):
    """2^x for lanes within (-126, 128): relative error 1.6e-7."""
    whole = _floor(x)
    f = x - whole
    return _times_power(((((f * _C5 + _C4) * f + _C3) * f + _C2) * f + _C1) * f + _C0, whole)


_floor = _llvm("floor")[lanes]
_LOG2E = np.float32(math.log2(math.e))


@simd_inline
def _exp(x):
    return select(x <= np.inf, exp2(minimum(maximum(x * _LOG2E, -125.0), 127.0)), x)  # NaN stays NaN


def exp(x):
    """e^x; lanes between e^-87 and e^88."""
    return math.exp(x)


one_argument(exp, {lanes: _exp}, lambda a: math.exp(a))


@intrinsic
def _split(typingctx, a):
    """Mantissa in [1, 2) and exponent of positive wide vectors."""

    def codegen(context, builder, signature, values):
        longs = ir.VectorType(ir.IntType(64), WIDE)
        digits, bias, shift, one = (
            constant([number] * WIDE, longs.element) for number in ((1 << 52) - 1, 1023, 52, 1023 << 52)
        )
        bits = builder.bitcast(values[0], longs)
        mantissa = builder.or_(builder.and_(bits, digits), one)
        power = builder.sub(builder.lshr(bits, shift), bias)
        parts = [builder.bitcast(mantissa, wide.llvm), builder.sitofp(power, wide.llvm)]
        return context.make_tuple(builder, signature.return_type, parts)

    return types.UniTuple(wide, 2)(wide), codegen


@simd_inline
def _log2(x):
    m, power = _split(x)
    high = m > 1.4142135623730951
    m, power = select(high, 0.5 * m, m), select(high, power + 1.0, power)
    t = (m - 1.0) / (m + 1.0)  # ln m = 2 atanh t
    q = t * t
    series = 1 / 15 + q * (1 / 17)
    series = 1.0 + q * (1 / 3 + q * (1 / 5 + q * (1 / 7 + q * (1 / 9 + q * (1 / 11 + q * (1 / 13 + q * series))))))
    return power + t * series * (2 / math.log(2))


def log2(x):
    """Logarithm to base 2 of positive numbers; wide vectors to 1e-15."""
    return math.log2(x)


one_argument(log2, {wide: _log2}, lambda a: math.log2(a))


def _reduction(name, start):
    def build(builder, a):
        values = (a,) if start is None else (ir.Constant(FLOAT, start), a)
        # Without reassoc, sums are a chain of scalar additions.
        return call(builder, name, FLOAT, *values, fastmath=(*FLAGS, "nnan" if start is None else "reassoc"))

    return unary(lanes, types.float32, build)


total = _reduction("llvm.vector.reduce.fadd.v16f32", -0.0)
largest = _reduction("llvm.vector.reduce.fmax.v16f32", None)


@intrinsic
def reduce_add(typingctx, a, b, c, d, e, f, g, h, i, j, k, l, m, n, o, p):  # noqa: E741
    """The sixteen values' sums over their lanes, as lanes: a tree of shuffles and additions shared by all."""

    def codegen(context, builder, signature, values):
        values, half = list(values), WIDTH // 2
        while half:
            # Values hold groups of 2 half partial sums; two values merge into one with groups half as long.
            low = [i for i in range(2 * WIDTH) if not i & half]
            high = [i + half for i in low]
            values = [
                builder.fadd(shuffle(builder, x, y, low), shuffle(builder, x, y, high), flags=FLAGS)
                for x, y in zip(values[::2], values[1::2], strict=True)
            ]
            half //= 2
        return values[0]

    return lanes(*[lanes] * WIDTH), codegen
