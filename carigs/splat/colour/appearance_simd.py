"""The kernels of `appearance` for float32, sixteen surfels at a time.

Kernels are specialized for the degree of the harmonics, which they take as a tuple of degree + 1 zeros: the length of a
tuple is part of its Numba type.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from numba.extending import overload

from carigs.simd.kernels import INLINE, kernel
from carigs.simd.memory import align_stack
from carigs.simd.records import load3, load_records, store3, store_records
from carigs.simd.tuples import componentwise, matrix_vector, multiply, outer
from carigs.simd.vector_loops import parallel_for_vectors
from carigs.simd.vector_math import absolute, select
from carigs.simd.vectors import WIDTH, broadcast, scalar_or_simd, simd_inline, simd_inline_alloc
from carigs.splat.colour.spherical_harmonics import BASIS, BASIS_GRADIENT, SH_BASE, num_coefficients


@simd_inline
def _light_factors(i, shade, binding, factors):
    """Factors of the light on sixteen surfels; `factors` is scratch space that holds 48 ones."""
    if len(shade) > 0:
        for r in range(WIDTH):
            f = 3 * np.int64(binding[i + r])
            factors[3 * r], factors[3 * r + 1], factors[3 * r + 2] = shade[f], shade[f + 1], shade[f + 2]
    return load3(factors, 0)


@scalar_or_simd
def clamped_channel(base, view_dependent, factor):
    """One channel of the colour; NaN stays NaN: the rasterizer culls such surfels.

    Args:
        base: Coefficient of degree 0.
        view_dependent: sum_k Y_k(d) h_k.
        factor: Factor of the light.

    Returns:
        max(0, (1/2 + Y_0 base + view_dependent) factor).
    """
    colour = (0.5 + SH_BASE * base + view_dependent) * factor
    return select(colour < 0.0, 0.0, colour)


@scalar_or_simd
def unclamped_gradient(colour, factor, g):
    """Gradient of one channel with respect to its value before the factor and the clamp.

    Args:
        colour: The channel.
        factor: Factor of the light.
        g: Gradient with respect to the channel.

    Returns:
        factor g where the colour is positive, else 0.
    """
    return select(colour > 0.0, factor * g, 0.0)


_clamped_colour, _unclamped_gradients = componentwise(clamped_channel), componentwise(unclamped_gradient)
_select = componentwise(select)


def _of_degree(degree):
    """View-dependent colour of sixteen surfels, sum_k Y_k(d) h_k, and its gradient, for degrees 1 to `degree`."""
    size, basis, basis_gradient = 3 * num_coefficients(degree), BASIS[degree], BASIS_GRADIENT[degree]
    load_coefficients, store_coefficients = load_records(size), store_records(size)

    @simd_inline
    def forward(i, harmonics, direction):
        b, h = basis(load3(direction, 3 * i)), load_coefficients(harmonics, size * i)
        red, green, blue = b[0] * h[0], b[0] * h[1], b[0] * h[2]
        for k in range(1, size // 3):
            red, green, blue = red + b[k] * h[3 * k], green + b[k] * h[3 * k + 1], blue + b[k] * h[3 * k + 2]
        return red, green, blue

    @simd_inline
    def backward(i, g, harmonics, direction, d_harmonics, d_direction):
        zero = broadcast(np.float32(0))
        unused = absolute(g[0]) + absolute(g[1]) + absolute(g[2]) <= zero
        d, h = _select(unused, zero, load3(direction, 3 * i)), load_coefficients(harmonics, size * i)
        store_coefficients(d_harmonics, size * i, outer(basis(d), g))
        store3(d_direction, 3 * i, _select(unused, zero, basis_gradient(d, matrix_vector(h, g))))

    return forward, backward


@simd_inline
def _no_colour(i, harmonics, direction):
    zero = broadcast(np.float32(0))
    return zero, zero, zero


@simd_inline
def _no_gradient(i, g, harmonics, direction, d_harmonics, d_direction):
    pass


def _by_degree(*functions):
    """One function of several by degree; its first argument is a tuple of degree + 1 zeros."""

    def function(degree, *arguments):
        raise NotImplementedError("only compiled kernels can call it")

    @overload(function, jit_options=INLINE)
    def choose(degree, *arguments):
        of_degree = functions[len(degree) - 1]
        return lambda degree, *arguments: of_degree(*arguments)

    return function


_view_dependent, _view_dependent_gradient = (
    _by_degree(*functions)
    for functions in zip((_no_colour, _no_gradient), _of_degree(1), _of_degree(2), _of_degree(3), strict=True)
)


@simd_inline
def _seen_colour(i, degree, binding, base, harmonics, direction, shade, colour, factors):
    """Colours of surfels i to i + 15."""
    align_stack()
    view_dependent = _view_dependent(degree, i, harmonics, direction)
    light = _light_factors(i, shade, binding, factors)
    store3(colour, 3 * i, _clamped_colour(load3(base, 3 * i), view_dependent, light))


@simd_inline
def _seen_colour_gradient(
    i, degree, binding, base, harmonics, direction, shade, colour, g_colour, d_base, d_harmonics, d_direction, factors
):
    align_stack()
    light = _light_factors(i, shade, binding, factors)
    g = _unclamped_gradients(load3(colour, 3 * i), light, load3(g_colour, 3 * i))
    store3(d_base, 3 * i, multiply(SH_BASE, g))
    _view_dependent_gradient(degree, i, g, harmonics, direction, d_harmonics, d_direction)


@simd_inline_alloc
def _ones():
    return (np.ones(3 * WIDTH, np.float32),)


@kernel
def _forward(degree, binding, *arguments):
    parallel_for_vectors(_seen_colour, len(binding), (degree, binding, *arguments), _ones)


@kernel
def _backward(degree, binding, *arguments):
    parallel_for_vectors(_seen_colour_gradient, len(binding), (degree, binding, *arguments), _ones)


KERNELS = tuple((partial(_forward, (0,) * n), partial(_backward, (0,) * n)) for n in range(1, 5))
"""Forward and backward kernels by degree; arguments as those of `appearance`'s scalar kernels."""
