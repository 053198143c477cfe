"""The kernels of `appearance` for float32, sixteen surfels at a time.

The last sixteen surfels overlap the ones before, so that there is no remainder. Kernels are specialized for the degree
of the harmonics, which they take as a tuple of degree + 1 zeros: the length of a tuple is part of its Numba type.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numba.extending import overload

from carigs.simd.kernels import INLINE, kernel, parallel_for
from carigs.simd.memory import align_stack, load3, load9, load_rows, store3, store9, store_rows
from carigs.simd.vector_math import absolute, select
from carigs.simd.vectors import WIDTH, broadcast, simd_inline, simd_inline_alloc
from carigs.splat.colour.spherical_harmonics import FUNCTIONS, SH_BASE, num_coefficients

PART_SIZE = 1024  # surfels of one task


@simd_inline
def _light_factors(i, shade, binding, factors):
    """Factors of the light on sixteen surfels; `factors` is scratch space that holds 48 ones."""
    if len(shade) > 0:
        for r in range(WIDTH):
            f = 3 * np.int64(binding[i + r])
            factors[3 * r], factors[3 * r + 1], factors[3 * r + 2] = shade[f], shade[f + 1], shade[f + 2]
    return load3(factors, 0)


@simd_inline
def _clamped_colour(base, view_dependent, factors, zero):
    """max(0, (1/2 + SH_BASE base + view_dependent) factors); NaN stays NaN: the rasterizer culls such surfels."""
    red = (0.5 + SH_BASE * base[0] + view_dependent[0]) * factors[0]
    green = (0.5 + SH_BASE * base[1] + view_dependent[1]) * factors[1]
    blue = (0.5 + SH_BASE * base[2] + view_dependent[2]) * factors[2]
    return select(red < zero, zero, red), select(green < zero, zero, green), select(blue < zero, zero, blue)


@simd_inline
def _unclamped_gradient(colour, factors, g, zero):
    """Gradient with respect to the colour before the factor and the clamp."""
    return (
        select(colour[0] > zero, factors[0] * g[0], zero), select(colour[1] > zero, factors[1] * g[1], zero),
        select(colour[2] > zero, factors[2] * g[2], zero),
    )  # fmt: skip


# The coefficients of sixteen surfels: 9, 24 or 45 numbers of each.


@simd_inline
def _load1(array, i):
    return load9(array, 9 * i)


@simd_inline
def _store1(array, i, h):
    store9(array, 9 * i, h)


@simd_inline
def _load2(array, i):
    a, b = load_rows(array, 24 * i, 24), load_rows(array, 24 * i + 8, 24)
    return (*a, *b[8:16])


@simd_inline
def _store2(array, i, h):
    store_rows(array, 24 * i + 8, 24, h[8:24])
    store_rows(array, 24 * i, 24, h[0:16])


@simd_inline
def _load3(array, i):
    a, b, c = load_rows(array, 45 * i, 45), load_rows(array, 45 * i + 16, 45), load_rows(array, 45 * i + 29, 45)
    return (*a, *b, *c[3:16])


@simd_inline
def _store3(array, i, h):
    store_rows(array, 45 * i + 29, 45, h[29:45])
    store_rows(array, 45 * i + 16, 45, h[16:32])
    store_rows(array, 45 * i, 45, h[0:16])


def _of_degree(degree, load, store):
    """View-dependent colour and its gradient for harmonics of degrees 1 to `degree`."""
    count = num_coefficients(degree)
    basis, basis_gradient, basis_times, coefficients_dot = FUNCTIONS[degree]

    @simd_inline
    def forward(i, harmonics, direction):
        b, h = basis(load3(direction, 3 * i)), load(harmonics, i)
        red, green, blue = b[0] * h[0], b[0] * h[1], b[0] * h[2]
        for k in range(1, count):
            red, green, blue = red + b[k] * h[3 * k], green + b[k] * h[3 * k + 1], blue + b[k] * h[3 * k + 2]
        return red, green, blue

    @simd_inline
    def backward(i, g, harmonics, direction, d_harmonics, d_direction):
        zero = broadcast(np.float32(0))
        unused = absolute(g[0]) + absolute(g[1]) + absolute(g[2]) <= zero
        d, h = load3(direction, 3 * i), load(harmonics, i)
        d = (select(unused, zero, d[0]), select(unused, zero, d[1]), select(unused, zero, d[2]))
        store(d_harmonics, i, basis_times(basis(d), g))
        s = basis_gradient(d, coefficients_dot(h, g))
        s = (select(unused, zero, s[0]), select(unused, zero, s[1]), select(unused, zero, s[2]))
        store3(d_direction, 3 * i, s)

    return forward, backward


_BY_DEGREE = (None, _of_degree(1, _load1, _store1), _of_degree(2, _load2, _store2), _of_degree(3, _load3, _store3))


def _view_dependent(i, degree, harmonics, direction):
    """sum_k Y_k(d) h_k of sixteen surfels; 0 for degree 0."""
    raise NotImplementedError("compiled only")


@overload(_view_dependent, jit_options=INLINE)
def _choose_view_dependent(i, degree, harmonics, direction):
    if len(degree) == 1:
        zero = np.float32(0)
        return lambda i, degree, harmonics, direction: (broadcast(zero), broadcast(zero), broadcast(zero))
    forward, _ = _BY_DEGREE[len(degree) - 1]
    return lambda i, degree, harmonics, direction: forward(i, harmonics, direction)


def _view_dependent_gradient(i, degree, g, harmonics, direction, d_harmonics, d_direction):
    """Store the gradients of harmonics and direction; nothing for degree 0."""
    raise NotImplementedError("compiled only")


@overload(_view_dependent_gradient, jit_options=INLINE)
def _choose_gradient(i, degree, g, harmonics, direction, d_harmonics, d_direction):
    if len(degree) == 1:
        return lambda i, degree, g, harmonics, direction, d_harmonics, d_direction: None
    _, backward = _BY_DEGREE[len(degree) - 1]
    return lambda i, degree, g, harmonics, direction, d_harmonics, d_direction: backward(
        i, g, harmonics, direction, d_harmonics, d_direction
    )


@simd_inline
def _forward_sixteen(i, degree, binding, base, harmonics, direction, shade, colour, factors):
    align_stack()
    view_dependent = _view_dependent(i, degree, harmonics, direction)
    light = _light_factors(i, shade, binding, factors)
    store3(colour, 3 * i, _clamped_colour(load3(base, 3 * i), view_dependent, light, broadcast(np.float32(0))))


@simd_inline_alloc
def _forward_part(part, degree, binding, base, harmonics, direction, shade, colour):
    factors = np.ones(3 * WIDTH, np.float32)
    for start in range(part * PART_SIZE, min((part + 1) * PART_SIZE, len(binding)), WIDTH):
        i = min(start, len(binding) - WIDTH)
        _forward_sixteen(i, degree, binding, base, harmonics, direction, shade, colour, factors)


@kernel
def _forward(degree, binding, *arguments):
    parallel_for(_forward_part, (len(binding) + PART_SIZE - 1) // PART_SIZE, (degree, binding, *arguments))


@simd_inline
def _backward_sixteen(
    i, degree, binding, base, harmonics, direction, shade, colour, g_colour, d_base, d_harmonics, d_direction, factors
):
    align_stack()
    light = _light_factors(i, shade, binding, factors)
    g = _unclamped_gradient(load3(colour, 3 * i), light, load3(g_colour, 3 * i), broadcast(np.float32(0)))
    store3(d_base, 3 * i, (SH_BASE * g[0], SH_BASE * g[1], SH_BASE * g[2]))
    _view_dependent_gradient(i, degree, g, harmonics, direction, d_harmonics, d_direction)


@simd_inline_alloc
def _backward_part(
    part, degree, binding, base, harmonics, direction, shade, colour, g_colour, d_base, d_harmonics, d_direction
):
    factors = np.ones(3 * WIDTH, np.float32)
    for start in range(part * PART_SIZE, min((part + 1) * PART_SIZE, len(binding)), WIDTH):
        _backward_sixteen(
            min(start, len(binding) - WIDTH), degree, binding, base, harmonics, direction, shade, colour, g_colour,
            d_base, d_harmonics, d_direction, factors,
        )  # fmt: skip


@kernel
def _backward(degree, binding, *arguments):
    parallel_for(_backward_part, (len(binding) + PART_SIZE - 1) // PART_SIZE, (degree, binding, *arguments))


KERNELS = tuple((partial(_forward, (0,) * n), partial(_backward, (0,) * n)) for n in range(1, 5))
"""Forward and backward kernels by degree; arguments as those of `appearance`'s scalar kernels."""
