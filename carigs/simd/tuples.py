"""Functions on tuples of numbers or vectors in Numba kernels: points, matrices, records.

Small arrays would be allocated on the heap. Numba compiles no loop that builds a tuple: here such loops are written out
for the lengths of the arguments.

Example:
    add((1.0, 2.0, 3.0), (4.0, 5.0, 6.0))       # (5.0, 7.0, 9.0)
    multiply(2.0, (1.0, 2.0, 3.0))              # (2.0, 4.0, 6.0)
    outer((1.0, 2.0), (3.0, 4.0))               # (3.0, 4.0, 6.0, 8.0)
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from functools import partial, reduce
from typing import NamedTuple

from llvmlite import ir
from numba import njit, types
from numba.core import cgutils
from numba.extending import intrinsic

from carigs.simd.kernels import INLINE


class Operand(NamedTuple):
    """A number, vector or array in the code of a kernel."""

    kind: types.Type
    value: ir.Value | None = None
    """None while Numba infers types."""


def tuple_function(components: Callable[..., list[Operand]]) -> Callable:
    """A function that returns a tuple.

    Args:
        components: Lists the components of the result. Its first argument is a function `call(function, *operands)`:
            the result of a function that kernels can call. The arguments follow: lists of operands for tuples, else
            operands. Integers may stand for operands.

    Returns:
        A function that kernels can call.
    """

    @intrinsic
    def function(typingctx, *arguments):
        def infer(function, *operands):
            return Operand(_signature(typingctx, function, operands)[1].return_type)

        kinds = types.BaseTuple.from_types(arguments)
        results = components(infer, *(_operands(kind) for kind in kinds))

        def codegen(context, builder, signature, values):
            def call(function, *operands):
                kind, called = _signature(typingctx, function, operands)
                pairs = zip(map(_as_operand, operands), called.args, strict=True)
                passed = [context.cast(builder, operand.value, operand.kind, to) for operand, to in pairs]
                return Operand(called.return_type, context.get_function(kind, called)(builder, passed))

            unpacked = zip(kinds, cgutils.unpack_tuple(builder, values[0]), strict=True)
            results = components(call, *(_operands(kind, value, builder) for kind, value in unpacked))
            return context.make_tuple(builder, signature.return_type, [result.value for result in results])

        return types.BaseTuple.from_types([result.kind for result in results])(kinds), codegen

    return function


def _as_operand(number):
    return Operand(types.intp, ir.Constant(ir.IntType(64), number)) if isinstance(number, int) else number


def _operands(kind, value=None, builder=None):
    """An argument as `components` takes it."""
    if not isinstance(kind, types.BaseTuple):
        return Operand(kind, value)
    values = [None] * len(kind) if value is None else cgutils.unpack_tuple(builder, value)
    return [Operand(*element) for element in zip(kind, values, strict=True)]


def _signature(typingctx, function, operands):
    """Numba's type of a function, and its signature for these operands."""
    kind = typingctx.resolve_value_type(function)
    return kind, typingctx.resolve_function_type(kind, tuple(_as_operand(operand).kind for operand in operands), {})


def componentwise(function: Callable) -> Callable:
    """A function of numbers or vectors as one of tuples: the tuple of its results for each component.

    Args:
        function: Function that kernels can call.

    Returns:
        The same function for tuples of one length; arguments that are no tuples stand beside every component.
    """

    def components(call, *arguments):
        length = max(len(a) for a in arguments if isinstance(a, list))
        rows = zip(*(a if isinstance(a, list) else [a] * length for a in arguments), strict=True)
        return [call(function, *row) for row in rows]

    return tuple_function(components)


add, subtract, multiply, divide = map(componentwise, (operator.add, operator.sub, operator.mul, operator.truediv))
"""Arithmetic of tuples, and of numbers with tuples."""
outer = tuple_function(lambda call, a, b: [call(operator.mul, x, y) for x in a for y in b])
"""Outer product of two tuples, row by row."""


def _matrix_vector(call, m, x):
    rows = [m[i : i + len(x)] for i in range(0, len(m), len(x))]
    return [reduce(partial(call, operator.add), map(partial(call, operator.mul), row, x)) for row in rows]


matrix_vector = tuple_function(_matrix_vector)
"""Product M x of a matrix, row by row, and a vector."""


@njit(**INLINE)
def _get(array, i, first, k):
    return array[i, first + k]


@njit(**INLINE)
def _set(array, i, first, k, value):
    array[i, first + k] = value


def read_row(count: int) -> Callable:
    """A function that reads part of a row of an array.

    Args:
        count: How many numbers it reads.

    Returns:
        Function of the array, the row, and the first column (0 if absent).
    """
    return tuple_function(lambda call, array, i, first=0: [call(_get, array, i, first, k) for k in range(count)])


write_row = tuple_function(
    lambda call, array, i, values, first=0: [call(_set, array, i, first, k, value) for k, value in enumerate(values)]
)
"""Write a tuple to part of a row: function of the array, the row, the tuple, and the first column (0 if absent)."""
