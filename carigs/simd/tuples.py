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

from numba import njit, types
from numba.extending import overload

from carigs.simd.kernels import INLINE


def tuple_function(components: Callable[..., list[str]], **names: object) -> Callable:
    """A function that returns a tuple, from expressions of its components.

    Args:
        components: Lists the expressions, given the length of each argument (0 for what is no tuple). In them,
            `a[0]`, `a[1]`, ... are the arguments.
        **names: Other names in the expressions.

    Returns:
        A function that kernels can call.

    Raises:
        NotImplementedError: If Python calls the function.
    """

    def function(*a):
        raise NotImplementedError("only compiled functions can call functions on tuples")

    @overload(function, jit_options=INLINE)
    def implementation(*a):
        lengths = [len(kind) if isinstance(kind, types.BaseTuple) else 0 for kind in a]
        return eval(f"lambda *a: ({', '.join(components(*lengths))},)", names)

    return function


def componentwise(function: Callable) -> Callable:
    """A function of numbers or vectors as one of tuples: the tuple of its results for each component.

    Args:
        function: Function that kernels can call.

    Returns:
        The same function for tuples of one length; arguments that are no tuples stand beside every component.
    """

    def components(*lengths):
        choices = [[f"a[{i}][{k}]" if n else f"a[{i}]" for i, n in enumerate(lengths)] for k in range(max(lengths))]
        return [f"function({', '.join(arguments)})" for arguments in choices]

    return tuple_function(components, function=function)


add, subtract, multiply, divide = map(componentwise, (operator.add, operator.sub, operator.mul, operator.truediv))
"""Arithmetic of tuples, and of numbers with tuples."""
outer = tuple_function(lambda m, n: [f"a[0][{i}] * a[1][{j}]" for i in range(m) for j in range(n)])
"""Outer product of two tuples, row by row."""
matrix_vector = tuple_function(
    lambda m, n: [" + ".join(f"a[0][{i + j}] * a[1][{j}]" for j in range(n)) for i in range(0, m, n)]
)
"""Product M x of a matrix, row by row, and a vector."""


def read_row(count: int) -> Callable:
    """A function that reads part of a row of an array.

    Args:
        count: How many numbers it reads.

    Returns:
        Function of the array, the row, and the first column (0 if absent).
    """
    return tuple_function(lambda *n: [f"a[0][a[1], {k}{' + a[2]' if len(n) > 2 else ''}]" for k in range(count)])


@njit(**INLINE)
def _set(array, i, k, value):
    array[i, k] = value


write_row = tuple_function(
    lambda *n: [f"set(a[0], a[1], {k}{' + a[3]' if len(n) > 3 else ''}, a[2][{k}])" for k in range(n[2])], set=_set
)
"""Write a tuple to part of a row: function of the array, the row, the tuple, and the first column (0 if absent)."""
