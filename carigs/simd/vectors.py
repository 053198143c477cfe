"""Vectors of floats as Numba values, so that a kernel's arithmetic is vector code by construction.

`lanes` is LLVM's <16 x float>, `wide` its <8 x double>, with `mask` and `wide_mask` for what comparisons give.  Values
live inside compiled functions only.  Operators + - * /, unary -, comparisons and & work between vectors, and with
scalars on either side; comparisons with NaN are false.  Processors with narrower registers get the same code split by
LLVM.  Functions are in `simd_math`, loads and stores in `simd_memory`.
"""

from __future__ import annotations

import operator

import numpy as np
from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic, models, overload, register_model

from carigs.simd.kernels import INLINE, INLINE_ALLOC

WIDTH, WIDE = 16, 8
FLOAT, DOUBLE, INT = ir.FloatType(), ir.DoubleType(), ir.IntType(32)

FASTMATH = {"contract", "nsz", "arcp", "afn"}
"""Neither nnan nor ninf: grazing rays and lanes that are masked later hold inf and NaN, and comparisons with those must
be false; a NaN in an image must come out as one.  Not reassoc either: a piece is optimised by itself and again inside
each kernel, each time in another order of operations; kernels that share a formula would differ in its digits."""
FLAGS = tuple(sorted(FASTMATH))


class Vector(types.Type):
    """`width` equal elements; told apart by name."""

    def __init__(self, name: str, element: ir.Type, width: int) -> None:
        super().__init__(name=name)
        self.element, self.width = element, width

    @property
    def llvm(self) -> ir.VectorType:
        """The machine's type."""
        return ir.VectorType(self.element, self.width)


class _Lanes(Vector):
    def __init__(self) -> None:
        super().__init__("lanes", FLOAT, WIDTH)


class _Wide(Vector):
    def __init__(self) -> None:
        super().__init__("wide", DOUBLE, WIDE)


class _Mask(Vector):
    def __init__(self) -> None:
        super().__init__("mask", ir.IntType(1), WIDTH)


class _WideMask(Vector):
    def __init__(self) -> None:
        super().__init__("wide_mask", ir.IntType(1), WIDE)


lanes, wide, mask, wide_mask = _Lanes(), _Wide(), _Mask(), _WideMask()
MASKS = {lanes: mask, wide: wide_mask}


def _model(vector: Vector) -> None:
    class Model(models.PrimitiveModel):
        def __init__(self, manager, kind):
            super().__init__(manager, kind, vector.llvm)

    register_model(type(vector))(Model)


for _vector in (lanes, wide, mask, wide_mask):
    _model(_vector)

simd_inline = njit(fastmath=FASTMATH, **INLINE)
simd_inline_alloc = njit(fastmath=FASTMATH, **INLINE_ALLOC)
"""Of pieces that make arrays."""
scalar_or_simd = njit(**INLINE)
"""For formulas that serve scalars too: those keep the order of their operations."""


def constant(values, element: ir.Type = FLOAT) -> ir.Constant:
    """A vector known when compiling."""
    values = list(values)
    return ir.Constant(ir.VectorType(element, len(values)), values)


def constant_like(value, number: float) -> ir.Constant:
    """`number` in all elements of a vector of the type of `value`."""
    return ir.Constant(value.type, [number] * value.type.count)


def shuffle(builder, a, b, index):
    """Elements of `a` followed by `b`, by number."""
    return builder.shuffle_vector(a, b, constant(index, INT))


def call(builder, name, result, *values, fastmath=()):
    """LLVM's function `name`."""
    kind = ir.FunctionType(result, [value.type for value in values])
    function = cgutils.get_or_insert_function(builder.module, kind, name)
    return builder.call(function, values, fastmath=fastmath)


def unary(argument, result, build):
    """An intrinsic of one vector; `build` emits its code."""

    @intrinsic
    def function(typingctx, a):
        if a != argument:
            return None
        return result(argument), lambda context, builder, signature, values: build(builder, values[0])

    return function


def binary(argument, result, build):
    """An intrinsic of two vectors of the same type; `build` emits its code."""

    @intrinsic
    def function(typingctx, a, b):
        if a != argument or b != argument:
            return None
        return result(argument, argument), lambda context, builder, signature, values: build(builder, *values)

    return function


def _splat(vector):
    @intrinsic
    def function(typingctx, number):
        def codegen(context, builder, signature, values):
            one = builder.insert_element(ir.Constant(vector.llvm, ir.Undefined), values[0], ir.Constant(INT, 0))
            return shuffle(builder, one, one, [0] * vector.width)

        return vector(types.float32 if vector == lanes else types.float64), codegen

    return function


broadcast, broadcast_wide = _splat(lanes), _splat(wide)
"""A scalar in all elements."""


def two_arguments(names, vectors, scalars=None):
    """Give functions of two arguments a meaning for vectors, for scalars beside them, and for scalars alone."""
    number = (types.Float, types.Integer)

    def choose(a, b):
        for vector, function in vectors.items():
            spread, kind = (broadcast, np.float32) if vector == lanes else (broadcast_wide, np.float64)
            if a == vector and b == vector:
                return lambda a, b: function(a, b)
            if a == vector and isinstance(b, number):
                return lambda a, b: function(a, spread(kind(b)))
            if b == vector and isinstance(a, number):
                return lambda a, b: function(spread(kind(a)), b)
        return scalars if isinstance(a, number) and isinstance(b, number) else None

    for name in names:
        overload(name, jit_options=INLINE)(choose)


def one_argument(name, vectors, scalars=None):
    """The same for one argument."""

    @overload(name, jit_options=INLINE)
    def choose(a):
        for vector, function in vectors.items():
            if a == vector:
                return lambda a: function(a)
        return scalars if isinstance(a, types.Float) else None


def _operator(symbols, build, compares=False):
    """Give `symbols` a meaning for vectors with vectors and with scalars."""
    two_arguments(symbols, {v: binary(v, MASKS[v] if compares else v, build) for v in (lanes, wide)})


_operator((operator.add, operator.iadd), lambda builder, a, b: builder.fadd(a, b, flags=FLAGS))
_operator((operator.sub, operator.isub), lambda builder, a, b: builder.fsub(a, b, flags=FLAGS))
_operator((operator.mul,), lambda builder, a, b: builder.fmul(a, b, flags=FLAGS))
_operator((operator.truediv,), lambda builder, a, b: builder.fdiv(a, b, flags=FLAGS))
_operator((operator.lt,), lambda builder, a, b: builder.fcmp_ordered("<", a, b), compares=True)
_operator((operator.le,), lambda builder, a, b: builder.fcmp_ordered("<=", a, b), compares=True)
_operator((operator.gt,), lambda builder, a, b: builder.fcmp_ordered(">", a, b), compares=True)
_operator((operator.ge,), lambda builder, a, b: builder.fcmp_ordered(">=", a, b), compares=True)


@overload(operator.and_, jit_options=INLINE)
def _choose_and(a, b):
    for vector, function in _ANDS.items():
        if a == vector and b == vector:
            return lambda a, b: function(a, b)
    return None


_ANDS = {v: binary(v, v, lambda builder, a, b: builder.and_(a, b)) for v in (mask, wide_mask)}
one_argument(
    operator.neg, {v: unary(v, v, lambda builder, a: builder.fsub(constant_like(a, -0.0), a)) for v in (lanes, wide)}
)
