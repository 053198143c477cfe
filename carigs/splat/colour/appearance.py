"""The colour that a surfel shows: c = max(0, f (1/2 + Y_0 dc + sum_k Y_k(d) h_k)), and its gradients (Numba).

d is the direction of view, h the spherical harmonics of degrees 1 to 3 (`harmonics`), f the factor of the light on the
surfel's triangle.  Here are the loops for one surfel after the other, which the tests check in float64, and in
`appearance_simd` those for sixteen.  What no pixel depends on has no gradient, whatever its numbers are (0 * NaN).
"""

from __future__ import annotations

import numba
import numpy as np
import torch
from jaxtyping import Float, Float32, Int
from numba.np.unsafe.ndarray import to_fixed_tuple
from torch import Tensor

from carigs.simd.vectors import WIDTH
from carigs.splat.colour import appearance_simd
from carigs.splat.colour.spherical_harmonics import BASIS, PAIRED, SCALED, SH_BASE, SLOPE, coefficients


def seen_colour(
    base: Float[Tensor, "n 3"],
    harmonics: Float[Tensor, "n k 3"],
    direction: Float[Tensor, "n 3"] | None,
    shade: Float32[np.ndarray, "f 3"] | None,
    binding: Int[np.ndarray, "n"],
) -> Float[Tensor, "n 3"]:
    """RGB of every surfel, not below 0, differentiable with respect to the tensors.

    `base` is the coefficient of degree 0; `direction` holds unit vectors from the eye to the surfels, None where there
    are no higher degrees.  Directions in the axes of the canonical head (`skinning.skin`) make the harmonics turn with
    it.  `shade` is the light's factor on each triangle, None for 1 everywhere.
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
        forward, ctx.kernel = appearance_simd.KERNELS[degree] if vectors else _SCALARS[degree]
        colour = np.empty_like(arrays[0])
        ctx.kept = (binding, *arrays, shade, colour)
        forward(*ctx.kept)
        ctx.shapes = [t.shape for t in tensors]
        return torch.from_numpy(colour).view(base.shape)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, g_colour):
        gradients = [np.empty_like(array) for array in ctx.kept[1:4]]
        ctx.kernel(*ctx.kept, g_colour.contiguous().numpy().reshape(-1), *gradients)
        tensors = [torch.from_numpy(d).view(shape) for d, shape in zip(gradients, ctx.shapes, strict=True)]
        return tensors[0], tensors[1], tensors[2] if len(tensors[2]) else None, None, None


def _numbers(count):
    @numba.njit
    def numbers(array, at):
        return to_fixed_tuple(array[at : at + count], count)

    return numbers


_three = _numbers(3)


@numba.njit
def _factors_of(f, shade):
    return _three(shade, 3 * f) if len(shade) > 0 else (1.0, 1.0, 1.0)


def _one_by_one(degree):
    """The same in scalars."""
    count, basis, slope = coefficients(degree), BASIS[degree], SLOPE[degree]
    scaled, paired, numbers = SCALED[degree], PAIRED[degree], _numbers(3 * coefficients(degree))

    @numba.njit(error_model="numpy")
    def forward(binding, base, harmonics, direction, shade, colour):
        for i in range(len(binding)):
            b, factor = basis(_three(direction, 3 * i)), _factors_of(binding[i], shade)
            for c in range(3):
                total = 0.5 + SH_BASE * base[3 * i + c]
                for k in range(count):
                    total += b[k] * harmonics[3 * (count * i + k) + c]
                total *= factor[c]
                colour[3 * i + c] = 0.0 if total < 0 else total

    @numba.njit(error_model="numpy")
    def backward(
        binding, base, harmonics, direction, shade, colour, g_colour, d_base, d_harmonics, d_direction
    ):  # fmt: skip
        for i in range(len(binding)):
            at, f = 3 * i, _factors_of(binding[i], shade)
            g = (
                f[0] * g_colour[at] if colour[at] > 0 else 0.0, f[1] * g_colour[at + 1] if colour[at + 1] > 0 else 0.0,
                f[2] * g_colour[at + 2] if colour[at + 2] > 0 else 0.0,
            )  # fmt: skip
            d_base[at], d_base[at + 1], d_base[at + 2] = SH_BASE * g[0], SH_BASE * g[1], SH_BASE * g[2]
            if g[0] == 0 and g[1] == 0 and g[2] == 0:
                d_harmonics[count * at : count * (at + 3)] = 0.0
                d_direction[at : at + 3] = 0.0
                continue
            d = _three(direction, at)
            dh = scaled(basis(d), g)
            for k in range(3 * count):
                d_harmonics[count * at + k] = dh[k]
            s = slope(d, paired(numbers(harmonics, count * at), g))
            for c in range(3):
                d_direction[at + c] = s[c]

    return forward, backward


@numba.njit(error_model="numpy")
def _scalar_forward0(binding, base, harmonics, direction, shade, colour):
    for i in range(len(binding)):
        factor = _factors_of(binding[i], shade)
        for c in range(3):
            total = (0.5 + SH_BASE * base[3 * i + c]) * factor[c]
            colour[3 * i + c] = 0.0 if total < 0 else total


@numba.njit(error_model="numpy")
def _scalar_backward0(
    binding, base, harmonics, direction, shade, colour, g_colour, d_base, d_harmonics, d_direction
):  # fmt: skip
    for i in range(len(binding)):
        factor = _factors_of(binding[i], shade)
        for c in range(3):
            at = 3 * i + c
            d_base[at] = SH_BASE * factor[c] * g_colour[at] if colour[at] > 0 else 0.0


# By degree: forward and backward.
_SCALARS = (_scalar_forward0, _scalar_backward0), _one_by_one(1), _one_by_one(2), _one_by_one(3)
