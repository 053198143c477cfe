"""The colour that a surfel shows: c = max(0, f (1/2 + Y_0 dc + sum_k Y_k(d) h_k)), and its gradients (Numba).

d is the direction of view, h the spherical harmonics of degrees 1 to 3 (`harmonics`), f the factor of the light on the
surfel's triangle.  Sixteen surfels at a time for float32, one by one for float64, which the tests check.  What no pixel
depends on has no gradient, whatever its numbers are (0 * NaN).
"""

from __future__ import annotations

import numba
import numpy as np
import torch
from jaxtyping import Float, Float32, Int
from numba.np.unsafe.ndarray import to_fixed_tuple
from torch import Tensor

from carigs.splat.harmonics import BASIS, PAIRED, SCALED, SH_BASE, SLOPE, coefficients
from carigs.splat.simd import WIDTH, inner, splat
from carigs.splat.simd_math import absolute, select
from carigs.splat.simd_memory import align_stack, load3, load9, load_rows, store3, store9, store_rows

PART = 1024  # surfels of one task


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
        forward, ctx.kernel = _VECTORS[degree] if vectors else _SCALARS[degree]
        colour = np.empty_like(arrays[0])
        forward(*arrays, shade, binding, colour)
        ctx.kept, ctx.shapes = (*arrays, shade, binding, colour), [t.shape for t in tensors]
        return torch.from_numpy(colour).view(base.shape)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, g_colour):
        gradients = [np.empty_like(array) for array in ctx.kept[:3]]
        ctx.kernel(*ctx.kept, g_colour.contiguous().numpy().reshape(-1), *gradients)
        tensors = [torch.from_numpy(d).view(shape) for d, shape in zip(gradients, ctx.shapes, strict=True)]
        return tensors[0], tensors[1], tensors[2] if len(tensors[2]) else None, None, None


@inner
def _factors(i, shade, binding, factor):
    """Of the light, on sixteen surfels; `factor` holds 48 ones."""
    if len(shade) > 0:
        for r in range(WIDTH):
            f = 3 * np.int64(binding[i + r])
            factor[3 * r], factor[3 * r + 1], factor[3 * r + 2] = shade[f], shade[f + 1], shade[f + 2]
    return load3(factor, 0)


@inner
def _shown(dc, more, factor, none):
    """NaN stays NaN: the rasteriser leaves such surfels out."""
    red, green, blue = (
        (0.5 + SH_BASE * dc[0] + more[0]) * factor[0], (0.5 + SH_BASE * dc[1] + more[1]) * factor[1],
        (0.5 + SH_BASE * dc[2] + more[2]) * factor[2],
    )  # fmt: skip
    return select(red < none, none, red), select(green < none, none, green), select(blue < none, none, blue)


@inner
def _through(colour, factor, g, none):
    """The gradient before the factor and the clamp."""
    return (
        select(colour[0] > none, factor[0] * g[0], none), select(colour[1] > none, factor[1] * g[1], none),
        select(colour[2] > none, factor[2] * g[2], none),
    )  # fmt: skip


@inner
def _forward0(i, base, harmonics, direction, shade, binding, colour, factor):
    align_stack()
    none = splat(np.float32(0))
    factors = _factors(i, shade, binding, factor)
    store3(colour, 3 * i, _shown(load3(base, 3 * i), (none, none, none), factors, none))


@inner
def _backward0(
    i, base, harmonics, direction, shade, binding, colour, g_colour, d_base, d_harmonics, d_direction, factor
):
    align_stack()
    factors = _factors(i, shade, binding, factor)
    g = _through(load3(colour, 3 * i), factors, load3(g_colour, 3 * i), splat(np.float32(0)))
    store3(d_base, 3 * i, (SH_BASE * g[0], SH_BASE * g[1], SH_BASE * g[2]))


@inner
def _load8(array, i):
    a, b = load_rows(array, 24 * i, 24), load_rows(array, 24 * i + 8, 24)
    return (*a, *b[8:16])


@inner
def _store8(array, i, h):
    store_rows(array, 24 * i + 8, 24, h[8:24])
    store_rows(array, 24 * i, 24, h[0:16])


@inner
def _load15(array, i):
    a, b, c = load_rows(array, 45 * i, 45), load_rows(array, 45 * i + 16, 45), load_rows(array, 45 * i + 29, 45)
    return (*a, *b, *c[3:16])


@inner
def _store15(array, i, h):
    store_rows(array, 45 * i + 29, 45, h[29:45])
    store_rows(array, 45 * i + 16, 45, h[16:32])
    store_rows(array, 45 * i, 45, h[0:16])


@inner
def _load3(array, i):
    return load9(array, 9 * i)


@inner
def _store3(array, i, h):
    store9(array, 9 * i, h)


def _numbers(count):
    @numba.njit
    def numbers(array, at):
        return to_fixed_tuple(array[at : at + count], count)

    return numbers


_three = _numbers(3)


@numba.njit
def _factors_of(f, shade):
    return _three(shade, 3 * f) if len(shade) > 0 else (1.0, 1.0, 1.0)


def _sixteen(degree, read, write):
    """Forward and backward of one degree for vectors."""
    count, basis, slope = coefficients(degree), BASIS[degree], SLOPE[degree]
    scaled, paired = SCALED[degree], PAIRED[degree]

    @inner
    def forward(i, base, harmonics, direction, shade, binding, colour, factor):
        align_stack()
        b, h = basis(load3(direction, 3 * i)), read(harmonics, i)
        red, green, blue = b[0] * h[0], b[0] * h[1], b[0] * h[2]
        for k in range(1, count):
            red, green, blue = red + b[k] * h[3 * k], green + b[k] * h[3 * k + 1], blue + b[k] * h[3 * k + 2]
        factors = _factors(i, shade, binding, factor)
        store3(colour, 3 * i, _shown(load3(base, 3 * i), (red, green, blue), factors, splat(np.float32(0))))

    @inner
    def backward(
        i, base, harmonics, direction, shade, binding, colour, g_colour, d_base, d_harmonics, d_direction, factor
    ):
        align_stack()
        none = splat(np.float32(0))
        g = _through(load3(colour, 3 * i), _factors(i, shade, binding, factor), load3(g_colour, 3 * i), none)
        store3(d_base, 3 * i, (SH_BASE * g[0], SH_BASE * g[1], SH_BASE * g[2]))
        still = absolute(g[0]) + absolute(g[1]) + absolute(g[2]) <= none
        d, h = load3(direction, 3 * i), read(harmonics, i)
        d = (select(still, none, d[0]), select(still, none, d[1]), select(still, none, d[2]))
        write(d_harmonics, i, scaled(basis(d), g))
        s = slope(d, paired(h, g))
        store3(d_direction, 3 * i, (select(still, none, s[0]), select(still, none, s[1]), select(still, none, s[2])))

    return forward, backward


def _one_by_one(degree):
    """The same in scalars."""
    count, basis, slope = coefficients(degree), BASIS[degree], SLOPE[degree]
    scaled, paired, numbers = SCALED[degree], PAIRED[degree], _numbers(3 * coefficients(degree))

    @numba.njit(error_model="numpy")
    def forward(base, harmonics, direction, shade, binding, colour):
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
        base, harmonics, direction, shade, binding, colour, g_colour, d_base, d_harmonics, d_direction
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
def _scalar_forward0(base, harmonics, direction, shade, binding, colour):
    for i in range(len(binding)):
        factor = _factors_of(binding[i], shade)
        for c in range(3):
            total = (0.5 + SH_BASE * base[3 * i + c]) * factor[c]
            colour[3 * i + c] = 0.0 if total < 0 else total


@numba.njit(error_model="numpy")
def _scalar_backward0(
    base, harmonics, direction, shade, binding, colour, g_colour, d_base, d_harmonics, d_direction
):  # fmt: skip
    for i in range(len(binding)):
        factor = _factors_of(binding[i], shade)
        for c in range(3):
            at = 3 * i + c
            d_base[at] = SH_BASE * factor[c] * g_colour[at] if colour[at] > 0 else 0.0


_forward1, _backward1 = _sixteen(1, _load3, _store3)
_forward2, _backward2 = _sixteen(2, _load8, _store8)
_forward3, _backward3 = _sixteen(3, _load15, _store15)

# One function for each degree: a cached closure that holds compiled functions would be compiled in every process.


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _forward_vectors0(base, harmonics, direction, shade, binding, colour):
    n = len(binding)
    for part in numba.prange((n + PART - 1) // PART):
        factor = np.ones(3 * WIDTH, np.float32)
        for start in range(part * PART, min((part + 1) * PART, n), WIDTH):
            _forward0(min(start, n - WIDTH), base, harmonics, direction, shade, binding, colour, factor)


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _backward_vectors0(base, harmonics, direction, shade, binding, colour, g_colour, d_base, d_harmonics, d_direction):
    n = len(binding)
    for part in numba.prange((n + PART - 1) // PART):
        factor = np.ones(3 * WIDTH, np.float32)
        for start in range(part * PART, min((part + 1) * PART, n), WIDTH):
            _backward0(
                min(start, n - WIDTH), base, harmonics, direction, shade, binding, colour, g_colour, d_base,
                d_harmonics, d_direction, factor,
            )  # fmt: skip


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _forward_vectors1(base, harmonics, direction, shade, binding, colour):
    n = len(binding)
    for part in numba.prange((n + PART - 1) // PART):
        factor = np.ones(3 * WIDTH, np.float32)
        for start in range(part * PART, min((part + 1) * PART, n), WIDTH):
            _forward1(min(start, n - WIDTH), base, harmonics, direction, shade, binding, colour, factor)


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _backward_vectors1(base, harmonics, direction, shade, binding, colour, g_colour, d_base, d_harmonics, d_direction):
    n = len(binding)
    for part in numba.prange((n + PART - 1) // PART):
        factor = np.ones(3 * WIDTH, np.float32)
        for start in range(part * PART, min((part + 1) * PART, n), WIDTH):
            _backward1(
                min(start, n - WIDTH), base, harmonics, direction, shade, binding, colour, g_colour, d_base,
                d_harmonics, d_direction, factor,
            )  # fmt: skip


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _forward_vectors2(base, harmonics, direction, shade, binding, colour):
    n = len(binding)
    for part in numba.prange((n + PART - 1) // PART):
        factor = np.ones(3 * WIDTH, np.float32)
        for start in range(part * PART, min((part + 1) * PART, n), WIDTH):
            _forward2(min(start, n - WIDTH), base, harmonics, direction, shade, binding, colour, factor)


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _backward_vectors2(base, harmonics, direction, shade, binding, colour, g_colour, d_base, d_harmonics, d_direction):
    n = len(binding)
    for part in numba.prange((n + PART - 1) // PART):
        factor = np.ones(3 * WIDTH, np.float32)
        for start in range(part * PART, min((part + 1) * PART, n), WIDTH):
            _backward2(
                min(start, n - WIDTH), base, harmonics, direction, shade, binding, colour, g_colour, d_base,
                d_harmonics, d_direction, factor,
            )  # fmt: skip


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _forward_vectors3(base, harmonics, direction, shade, binding, colour):
    n = len(binding)
    for part in numba.prange((n + PART - 1) // PART):
        factor = np.ones(3 * WIDTH, np.float32)
        for start in range(part * PART, min((part + 1) * PART, n), WIDTH):
            _forward3(min(start, n - WIDTH), base, harmonics, direction, shade, binding, colour, factor)


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _backward_vectors3(base, harmonics, direction, shade, binding, colour, g_colour, d_base, d_harmonics, d_direction):
    n = len(binding)
    for part in numba.prange((n + PART - 1) // PART):
        factor = np.ones(3 * WIDTH, np.float32)
        for start in range(part * PART, min((part + 1) * PART, n), WIDTH):
            _backward3(
                min(start, n - WIDTH), base, harmonics, direction, shade, binding, colour, g_colour, d_base,
                d_harmonics, d_direction, factor,
            )  # fmt: skip


# By degree: forward, backward.
_VECTORS = (
    (_forward_vectors0, _backward_vectors0), (_forward_vectors1, _backward_vectors1),
    (_forward_vectors2, _backward_vectors2), (_forward_vectors3, _backward_vectors3),
)  # fmt: skip
_SCALARS = (
    (_scalar_forward0, _scalar_backward0), _one_by_one(1),
    _one_by_one(2), _one_by_one(3),
)  # fmt: skip
