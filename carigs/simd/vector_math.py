"""Functions of the vectors of `carigs.simd.vectors`.

`sqrt`, `exp`, `log2`, `floor`, `absolute`, `minimum`, `maximum` and `select` take vectors and scalars alike: a formula
written with them once serves plain loops in float64 and vector loops.
"""

from __future__ import annotations

import math

import numpy as np
from numba import types
from numba.extending import intrinsic, overload

from carigs.simd.ir_values import DOUBLE, FLOAT, INT, LONG, constant, generate
from carigs.simd.kernels import INLINE
from carigs.simd.vectors import (
    BROADCAST,
    MASKS,
    WIDE,
    WIDTH,
    binary_intrinsic,
    int_lanes,
    lanes,
    overload_binary,
    overload_unary,
    simd_inline,
    unary_intrinsic,
    wide,
)


def _llvm(name):
    """LLVM's function of one vector, for both types."""
    return {v: unary_intrinsic(v, v, lambda a: a.call(name)) for v in MASKS}


def sqrt(x):
    """Square root.

    Args:
        x: Scalar or vector.

    Returns:
        The same type as `x`.
    """
    return math.sqrt(x)


def absolute(x):
    """Absolute value.

    Args:
        x: Scalar or vector.

    Returns:
        The same type as `x`.
    """
    return abs(x)


def floor(x):
    """The largest integer that is not above x, as a float.

    Args:
        x: Scalar or vector.

    Returns:
        The same type as `x`.
    """
    return math.floor(x)


overload_unary(sqrt, _llvm("sqrt"), lambda a: math.sqrt(a))
overload_unary(absolute, _llvm("fabs"), lambda a: abs(a))
overload_unary(floor, _llvm("floor"), lambda a: np.floor(a))


def minimum(a, b):
    """A if a < b, else b: also where one is NaN.

    Args:
        a: Scalar or vector.
        b: Scalar or vector.

    Returns:
        A vector if one of the arguments is one.
    """
    return a if a < b else b


def maximum(a, b):
    """A if a > b, else b: also where one is NaN.

    Args:
        a: Scalar or vector.
        b: Scalar or vector.

    Returns:
        A vector if one of the arguments is one.
    """
    return a if a > b else b


# Compare and select rather than LLVM's min and max, for which the result with NaN is not fixed.
for _function, _build, _scalars in (
    (minimum, lambda a, b: a.where(a < b, b), lambda a, b: a if a < b else b),
    (maximum, lambda a, b: a.where(a > b, b), lambda a, b: a if a > b else b),
):
    overload_binary((_function,), {v: binary_intrinsic(v, v, _build) for v in MASKS}, _scalars)


def select(condition, a, b):
    """A where the condition holds, else b.

    Args:
        condition: Mask, or truth value.
        a: Scalar or vector.
        b: Scalar or vector.

    Returns:
        A vector if `condition` is a mask.
    """
    return a if condition else b


def _select_intrinsic(vector):
    @intrinsic
    def function(typingctx, condition, a, b):
        return vector(MASKS[vector], vector, vector), generate(lambda condition, a, b: a.where(condition, b))

    return function


_SELECT = {MASKS[v]: (BROADCAST[v], _select_intrinsic(v)) for v in MASKS}


@overload(select, jit_options=INLINE)
def _overload_select(condition, a, b):
    if condition not in _SELECT:
        return lambda condition, a, b: a if condition else b
    as_vector, function = _SELECT[condition]
    return lambda condition, a, b: function(condition, as_vector(a), as_vector(b))


@intrinsic
def block_columns(typingctx):
    """Column of each lane in a block of 4 x 4 pixels: 0 0 0 0 1 1 1 1 2 ...

    Args:
        typingctx: Supplied by Numba; callers leave it out.

    Returns:
        Lanes.
    """
    return lanes(), lambda *call: constant(i // 4 for i in range(WIDTH))


@intrinsic
def block_rows(typingctx):
    """Row of each lane in a block of 4 x 4 pixels: 0 1 2 3 0 1 2 ...

    Args:
        typingctx: Supplied by Numba; callers leave it out.

    Returns:
        Lanes.
    """
    return lanes(), lambda *call: constant(i % 4 for i in range(WIDTH))


promote_lower, promote_upper = (
    unary_intrinsic(lanes, wide, lambda a, at=at: a.shuffle(a, range(at, at + WIDE)).to(DOUBLE)) for at in (0, WIDE)
)
"""The first eight and the last eight of sixteen lanes, in double precision."""
demote = binary_intrinsic(wide, lanes, lambda a, b: a.to(FLOAT).shuffle(b.to(FLOAT), range(WIDTH)))
"""Two wide vectors as sixteen lanes, rounded to single precision: the inverse of the two above."""
to_int = unary_intrinsic(lanes, int_lanes, lambda a: a.to(INT))
"""Conversion to 32-bit integers, towards zero; for `store` to integer arrays."""


@intrinsic
def _times_power(typingctx, a, exponent):
    """A * 2^exponent for lanes with integer exponents, by adding to the bits of a's exponent."""
    build = generate(lambda a, exponent: (a.bits(INT) + (exponent.to(INT) << 23)).bits(FLOAT))
    return lanes(lanes, lanes), build


# Minimax in relative error on [0, 1].
_C0, _C1, _C2, _C3, _C4, _C5 = (
    np.float32(c) for c in (0.99999993, 0.69315307, 0.24015362, 0.055826318, 0.0089893401, 0.0018775767)
)


@simd_inline
def exp2(x):
    """2^x, relative error 1.6e-7.

    Args:
        x: Lanes within (-126, 128).

    Returns:
        Lanes.
    """
    whole = floor(x)
    f = x - whole
    return _times_power(((((f * _C5 + _C4) * f + _C3) * f + _C2) * f + _C1) * f + _C0, whole)


_LOG2E = np.float32(math.log2(math.e))


@simd_inline
def _exp(x):
    return select(x <= np.inf, exp2(minimum(maximum(x * _LOG2E, -125.0), 127.0)), x)  # NaN stays NaN


def exp(x):
    """e^x; of lanes between e^-87 and e^88.

    Args:
        x: Scalar or lanes.

    Returns:
        The same type as `x`.
    """
    return math.exp(x)


overload_unary(exp, {lanes: _exp}, lambda a: math.exp(a))


@intrinsic
def _split(typingctx, a):
    """Mantissa in [1, 2) and exponent of positive wide vectors."""

    def build(a):
        bits = a.bits(LONG)
        mantissa = (bits & ((1 << 52) - 1)) | (1023 << 52)
        return [mantissa.bits(DOUBLE), ((bits >> 52) - 1023).to(DOUBLE)]

    return types.UniTuple(wide, 2)(wide), generate(build)


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
    """Logarithm to base 2; of wide vectors with an error of 1e-15.

    Args:
        x: Positive scalar or wide vector.

    Returns:
        The same type as `x`.
    """
    return math.log2(x)


overload_unary(log2, {wide: _log2}, lambda a: math.log2(a))
