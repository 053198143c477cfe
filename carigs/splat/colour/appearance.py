"""The colour of a surfel along a view direction, and its gradients (Numba).

    c = max(0, f (1/2 + Y_0 base + sum_k Y_k(d) h_k))

with the view direction d, the coefficients h of the spherical harmonics of degrees 1 to 3 (3D Gaussian Splatting, Kerbl
et al. 2023), and the factor f of the light on the surfel's triangle. The gradients of a channel with c > 0 and upstream
gradient g are f g Y_0 (base), f g Y_k(d) (h_k) and f g sum_k h_k grad Y_k(d) (d); those of a clamped channel are 0.

This module holds the scalar kernels, which the tests check in float64; `appearance_simd` computes sixteen surfels at a
time. Surfels that no pixel depends on have zero gradients even where their numbers are not finite (0 * NaN).
"""

from __future__ import annotations

import numba
import numpy as np
import torch
from jaxtyping import Float, Float32, Int
from torch import Tensor

from carigs.simd.tuples import componentwise, matrix_vector, multiply, tuple_function
from carigs.simd.vectors import WIDTH
from carigs.splat.colour import appearance_simd
from carigs.splat.colour.spherical_harmonics import BASIS, BASIS_GRADIENT, SH_BASE, num_coefficients


def seen_colour(
    base: Float[Tensor, "n 3"],
    harmonics: Float[Tensor, "n k 3"],
    direction: Float[Tensor, "n 3"] | None,
    shade: Float32[np.ndarray, "f 3"] | None,
    binding: Int[np.ndarray, " n"],
) -> Float[Tensor, "n 3"]:
    """Colour of every surfel along its view direction, in its light; differentiable with respect to the tensors.

    Args:
        base: Coefficients of degree 0.
        harmonics: Coefficients of degrees 1 to 3 (k = 0, 3, 8 or 15).
        direction: Unit vectors from the eye to the surfels; None if k = 0. In the axes of the canonical head
            (`skinning.skin`) the harmonics rotate with the head.
        shade: RGB factors of the light on each triangle; None for 1 everywhere.
        binding: Triangle of each surfel.

    Returns:
        RGB, not below 0.
    """
    return _SeenColour.apply(base, harmonics, direction, shade, binding)


class _SeenColour(torch.autograd.Function):
    @staticmethod
    def forward(ctx, base, harmonics, direction, shade, binding):
        tensors = (base, harmonics, base.new_empty(0) if direction is None else direction)
        arrays = [t.detach().contiguous().numpy().reshape(-1) for t in tensors]
        shade = np.empty(0, arrays[0].dtype) if shade is None else shade.astype(arrays[0].dtype).reshape(-1)
        degree = round((harmonics.shape[1] + 1) ** 0.5) - 1
        vectors = base.dtype == torch.float32 and len(base) >= WIDTH
        forward, ctx.backward_kernel = appearance_simd.KERNELS[degree] if vectors else _SCALAR_KERNELS[degree]
        colour = np.empty_like(arrays[0])
        ctx.arguments = (binding, *arrays, shade, colour)
        forward(*ctx.arguments)
        ctx.shapes = [t.shape for t in tensors]
        return torch.from_numpy(colour).view(base.shape)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, g_colour):
        gradients = [np.empty_like(array) for array in ctx.arguments[1:4]]
        ctx.backward_kernel(*ctx.arguments, g_colour.contiguous().numpy().reshape(-1), *gradients)
        tensors = [torch.from_numpy(d).view(shape) for d, shape in zip(gradients, ctx.shapes, strict=True)]
        return tensors[0], tensors[1], tensors[2] if len(tensors[2]) else None, None, None


@numba.njit
def _number(array, first, k):
    return array[first + k]


def _numbers(count):
    """A function that reads `count` numbers of an array as a tuple."""
    return tuple_function(lambda call, array, first: [call(_number, array, first, k) for k in range(count)])


_three = _numbers(3)
_unclamped = componentwise(appearance_simd.unclamped_gradient)


@numba.njit
def _light_factors(f, shade):
    return _three(shade, 3 * f) if len(shade) > 0 else (1.0, 1.0, 1.0)


def _scalar_kernels(degree):
    """Forward and backward loops for harmonics of degrees 1 to `degree`."""
    count, coefficients = num_coefficients(degree), _numbers(3 * num_coefficients(degree))
    basis, basis_gradient = BASIS[degree], BASIS_GRADIENT[degree]

    @numba.njit(error_model="numpy")
    def forward(binding, base, harmonics, direction, shade, colour):
        for i in range(len(binding)):
            b, factors = basis(_three(direction, 3 * i)), _light_factors(binding[i], shade)
            for c in range(3):
                total = 0.5 + SH_BASE * base[3 * i + c]
                for k in range(count):
                    total += b[k] * harmonics[3 * (count * i + k) + c]
                total *= factors[c]
                colour[3 * i + c] = 0.0 if total < 0 else total

    @numba.njit(error_model="numpy")
    def backward(binding, base, harmonics, direction, shade, colour, g_colour, d_base, d_harmonics, d_direction):
        for i in range(len(binding)):
            at, factors = 3 * i, _light_factors(binding[i], shade)
            g = _unclamped(_three(colour, at), factors, _three(g_colour, at))
            d_base[at], d_base[at + 1], d_base[at + 2] = multiply(SH_BASE, g)
            if g[0] == 0 and g[1] == 0 and g[2] == 0:
                d_harmonics[count * at : count * (at + 3)] = 0.0
                d_direction[at : at + 3] = 0.0
                continue
            d = _three(direction, at)
            b = basis(d)
            for k in range(count):
                for c in range(3):
                    d_harmonics[count * at + 3 * k + c] = b[k] * g[c]
            s = basis_gradient(d, matrix_vector(coefficients(harmonics, count * at), g))
            for c in range(3):
                d_direction[at + c] = s[c]

    return forward, backward


@numba.njit(error_model="numpy")
def _scalar_forward0(binding, base, harmonics, direction, shade, colour):
    for i in range(len(binding)):
        factors = _light_factors(binding[i], shade)
        for c in range(3):
            total = (0.5 + SH_BASE * base[3 * i + c]) * factors[c]
            colour[3 * i + c] = 0.0 if total < 0 else total


@numba.njit(error_model="numpy")
def _scalar_backward0(binding, base, harmonics, direction, shade, colour, g_colour, d_base, d_harmonics, d_direction):
    for i in range(len(binding)):
        factors = _light_factors(binding[i], shade)
        for c in range(3):
            at = 3 * i + c
            d_base[at] = SH_BASE * factors[c] * g_colour[at] if colour[at] > 0 else 0.0


# Forward and backward kernels by degree.
_SCALAR_KERNELS = (_scalar_forward0, _scalar_backward0), _scalar_kernels(1), _scalar_kernels(2), _scalar_kernels(3)
