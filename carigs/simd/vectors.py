"""Vectors of floats as Numba values, so that a kernel's arithmetic is vector code by construction.

`lanes` is LLVM's <16 x float>, `wide` its <8 x double>; comparisons give `mask` and `wide_mask`. `int_lanes` is LLVM's
<16 x i32>, which kernels only store. Values live inside compiled functions only. Operators + - * / & and unary -, and
comparisons, work between vectors and with scalars on either side; comparisons with NaN are false. LLVM splits the
vectors on processors with narrower registers. Functions are in `carigs.simd.vector_math`, loads and stores in
`carigs.simd.memory`.
"""

from __future__ import annotations

import operator
from collections.abc import Callable, Sequence

from llvmlite import ir
from numba import njit, types
from numba.extending import intrinsic, models, overload, register_model

from carigs.simd.ir_values import DOUBLE, FLOAT, INT, Value, generate
from carigs.simd.kernels import INLINE, INLINE_ALLOC

WIDTH, WIDE = 16, 8

FASTMATH = {"contract", "nsz", "arcp", "afn"}
"""LLVM's fast-math flags of vector arithmetic. Neither nnan nor ninf: grazing rays and lanes that are masked later hold
inf and NaN, whose comparisons must be false, and a NaN in an image must come out as one. Not reassoc either: a function
is optimised by itself and again inside each kernel, in different orders of operations, so that kernels that share a
formula would differ in its last digits."""
FLAGS = tuple(sorted(FASTMATH))


class Vector(types.Type):
    """Numba's type of vectors of `width` elements of one LLVM type."""

    def __init__(self, name: str, element: ir.Type, width: int) -> None:
        super().__init__(name=name)
        self.element, self.width = element, width


@register_model(Vector)
class _VectorModel(models.PrimitiveModel):
    def __init__(self, manager, kind):
        super().__init__(manager, kind, ir.VectorType(kind.element, kind.width))


lanes, wide = Vector("lanes", FLOAT, WIDTH), Vector("wide", DOUBLE, WIDE)
int_lanes = Vector("int_lanes", INT, WIDTH)
mask, wide_mask = Vector("mask", ir.IntType(1), WIDTH), Vector("wide_mask", ir.IntType(1), WIDE)
MASKS = {lanes: mask, wide: wide_mask}

simd_inline = njit(fastmath=FASTMATH, **INLINE)
"""Decorator of functions on vectors that kernels call."""
simd_inline_alloc = njit(fastmath=FASTMATH, **INLINE_ALLOC)
"""The same for functions that allocate arrays."""
scalar_or_simd = njit(**INLINE)
"""Decorator of formulas for vectors and scalars; scalar operations keep their order."""


def unary_intrinsic(argument: types.Type, result: types.Type, build: Callable[[Value], Value]) -> Callable:
    """An intrinsic of one vector.

    Args:
        argument: Type of the vector.
        result: Type of the result.
        build: Function of LLVM values that computes it.

    Returns:
        A function that kernels can call.
    """

    @intrinsic
    def function(typingctx, a):
        return (result(argument), generate(build)) if a == argument else None

    return function


def binary_intrinsic(argument: types.Type, result: types.Type, build: Callable[[Value, Value], Value]) -> Callable:
    """An intrinsic of two vectors of the same type.

    Args:
        argument: Type of the vectors.
        result: Type of the result.
        build: Function of LLVM values that computes it.

    Returns:
        A function that kernels can call.
    """

    @intrinsic
    def function(typingctx, a, b):
        return (result(argument, argument), generate(build)) if a == argument and b == argument else None

    return function


def _broadcast(vector: Vector) -> Callable:
    @intrinsic
    def function(typingctx, a):
        if a == vector:
            return vector(vector), generate(lambda a: a)
        scalar = types.float32 if vector == lanes else types.float64
        return vector(scalar), generate(lambda a: a.broadcast(vector.width))

    return function


BROADCAST = {v: _broadcast(v) for v in MASKS}
"""By type of vector: a scalar in all elements; a vector as it is."""
broadcast = BROADCAST[lanes]
"""A scalar in all sixteen lanes."""


def overload_binary(functions: Sequence, vectors: dict[Vector, Callable], scalars: Callable | None = None) -> None:
    """Give functions of two arguments a meaning in kernels: for vectors, vectors beside scalars, and scalars.

    Args:
        functions: Python functions or operators.
        vectors: Implementation for two vectors of each type.
        scalars: Implementation for two scalars, if any.
    """
    number = (types.Float, types.Integer)

    def implementation(a, b):
        for vector, of_vectors in vectors.items():
            if vector in (a, b) and all(kind == vector or isinstance(kind, number) for kind in (a, b)):
                as_vector = BROADCAST[vector]
                return lambda a, b: of_vectors(as_vector(a), as_vector(b))
        return scalars if isinstance(a, number) and isinstance(b, number) else None

    for function in functions:
        overload(function, jit_options=INLINE)(implementation)


def overload_unary(function: Callable, vectors: dict[Vector, Callable], scalars: Callable | None = None) -> None:
    """Give a function of one argument a meaning in kernels: for vectors and for scalars.

    Args:
        function: Python function or operator.
        vectors: Implementation for each vector type.
        scalars: Implementation for floats, if any.
    """

    @overload(function, jit_options=INLINE)
    def implementation(a):
        if a in vectors:
            of_vector = vectors[a]
            return lambda a: of_vector(a)
        return scalars if isinstance(a, types.Float) else None


def arithmetic(name: str) -> Callable[[Value, Value], Value]:
    """An LLVM instruction on two vectors of floats, with `FASTMATH`.

    Args:
        name: Method of llvmlite's `IRBuilder`, such as `fadd`.

    Returns:
        A function of two values.
    """
    return lambda a, b: a.new(getattr(a.builder, name)(a.llvm, b.llvm, flags=FLAGS))


for _functions, _name in (
    ((operator.add, operator.iadd), "fadd"),
    ((operator.sub, operator.isub), "fsub"),
    ((operator.mul,), "fmul"),
    ((operator.truediv,), "fdiv"),
):
    overload_binary(_functions, {v: binary_intrinsic(v, v, arithmetic(_name)) for v in MASKS})
for _comparison in (operator.lt, operator.le, operator.gt, operator.ge):
    overload_binary((_comparison,), {v: binary_intrinsic(v, MASKS[v], _comparison) for v in MASKS})
overload_unary(operator.neg, {v: unary_intrinsic(v, v, lambda a: a.constants([-0.0] * a.width) - a) for v in MASKS})


@overload(operator.and_, jit_options=INLINE)
def _overload_and(a, b):
    function = _ANDS.get(a)
    return (lambda a, b: function(a, b)) if function and a == b else None


_ANDS = {v: binary_intrinsic(v, v, operator.and_) for v in (mask, wide_mask)}

any_wide = unary_intrinsic(wide_mask, types.boolean, lambda a: a.new(a.any()))
"""Whether a mask of wide vectors is set anywhere."""
