"""View-dependent colour: real spherical harmonics of degrees 1 to 3, and their gradients (Numba).

Order and signs are those of 3D Gaussian splatting (Condon-Shortley phase, m = -l .. l), so that its files fit.  The
formulas take tuples of numbers: vectors of sixteen surfels for float32, scalars for float64, which the tests check.
"""

from __future__ import annotations

import numba
import numpy as np
import torch
from jaxtyping import Float
from numba.np.unsafe.ndarray import to_fixed_tuple
from torch import Tensor

from carigs.splat import matrix3
from carigs.splat.simd import WIDTH, formula, inner, splat
from carigs.splat.simd_math import absolute, select
from carigs.splat.simd_memory import align_stack, load3, load9, load_rows, store3, store9, store_rows

PART = 1024  # surfels of one task
_A, _B, _C, _D = 0.4886025119029199, 1.0925484305920792, 0.31539156525252005, 0.5462742152960396
_E, _F, _G, _H, _I = 0.5900435899266435, 2.890611442640554, 0.4570457994644658, 0.3731763325901154, 1.445305721320277


def coefficients(degree: int) -> int:
    """Number of basis functions of degrees 1 .. `degree`."""
    return (degree + 1) ** 2 - 1


@formula
def _basis1(d):
    x, y, z = d
    return -_A * y, _A * z, -_A * x


@formula
def _basis2(d):
    x, y, z = d
    return (
        *_basis1(d), _B * x * y, -_B * y * z, _C * (2 * z * z - x * x - y * y), -_B * x * z, _D * (x * x - y * y),
    )  # fmt: skip


@formula
def _basis3(d):
    x, y, z = d
    xx, yy, zz = x * x, y * y, z * z
    return (
        *_basis2(d), -_E * y * (3 * xx - yy), _F * x * y * z, -_G * y * (4 * zz - xx - yy),
        _H * z * (2 * zz - 3 * xx - 3 * yy), -_G * x * (4 * zz - xx - yy), _I * z * (xx - yy), -_E * x * (xx - 3 * yy),
    )  # fmt: skip


@formula
def _slope1(d, s):
    """Gradient of sum_k s_k basis_k with respect to the direction."""
    return -_A * s[2], -_A * s[0], _A * s[1]


@formula
def _slope2(d, s):
    x, y, z = d
    a, b, c = _slope1(d, s)
    return (
        a + _B * (y * s[3] - z * s[6]) + 2 * x * (_D * s[7] - _C * s[5]),
        b + _B * (x * s[3] - z * s[4]) - 2 * y * (_D * s[7] + _C * s[5]),
        c - _B * (y * s[4] + x * s[6]) + 4 * _C * z * s[5],
    )


@formula
def _slope3(d, s):
    x, y, z = d
    xx, yy, zz = x * x, y * y, z * z
    a, b, c = _slope2(d, s)
    a = a - 6 * _E * x * y * s[8] + _F * y * z * s[9] + 2 * _G * x * y * s[10] - 6 * _H * x * z * s[11]
    b = b - 3 * _E * (xx - yy) * s[8] + _F * x * z * s[9] - _G * (4 * zz - xx - 3 * yy) * s[10] - 6 * _H * y * z * s[11]
    c = c + _F * x * y * s[9] - 8 * _G * y * z * s[10] + 3 * _H * (2 * zz - xx - yy) * s[11]
    return (
        a - _G * (4 * zz - 3 * xx - yy) * s[12] + 2 * _I * x * z * s[13] - 3 * _E * (xx - yy) * s[14],
        b + 2 * _G * x * y * s[12] - 2 * _I * y * z * s[13] + 6 * _E * x * y * s[14],
        c - 8 * _G * x * z * s[12] + _I * (xx - yy) * s[13],
    )


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


@formula
def _times(b, g):
    return b * g[0], b * g[1], b * g[2]


@formula
def _scaled1(b, g):
    """basis_k g_c: the gradient of the coefficients, colour by colour."""
    return (*_times(b[0], g), *_times(b[1], g), *_times(b[2], g))


@formula
def _scaled2(b, g):
    return (
        *_scaled1(b, g), *_times(b[3], g), *_times(b[4], g), *_times(b[5], g), *_times(b[6], g), *_times(b[7], g),
    )  # fmt: skip


@formula
def _scaled3(b, g):
    return (
        *_scaled2(b, g), *_times(b[8], g), *_times(b[9], g), *_times(b[10], g), *_times(b[11], g), *_times(b[12], g),
        *_times(b[13], g), *_times(b[14], g),
    )  # fmt: skip


@formula
def _paired1(h, g):
    """sum_c h_kc g_c: the gradient of the basis functions."""
    return matrix3.dot(h[0:3], g), matrix3.dot(h[3:6], g), matrix3.dot(h[6:9], g)


@formula
def _paired2(h, g):
    return (
        *_paired1(h, g), matrix3.dot(h[9:12], g), matrix3.dot(h[12:15], g), matrix3.dot(h[15:18], g),
        matrix3.dot(h[18:21], g), matrix3.dot(h[21:24], g),
    )  # fmt: skip


@formula
def _paired3(h, g):
    return (
        *_paired2(h, g), matrix3.dot(h[24:27], g), matrix3.dot(h[27:30], g), matrix3.dot(h[30:33], g),
        matrix3.dot(h[33:36], g), matrix3.dot(h[36:39], g), matrix3.dot(h[39:42], g), matrix3.dot(h[42:45], g),
    )  # fmt: skip


def _numbers(count):
    @numba.njit
    def numbers(array, at):
        return to_fixed_tuple(array[at : at + count], count)

    return numbers


_three = _numbers(3)


def _kernels(degree, basis, slope, scaled, paired, read, write):
    """The loops of one degree, forward and backward: sixteen surfels at a time, and one by one."""
    count = coefficients(degree)
    numbers = _numbers(3 * count)

    @formula
    def summed(b, h):
        red, green, blue = b[0] * h[0], b[0] * h[1], b[0] * h[2]
        for k in range(1, count):
            red, green, blue = red + b[k] * h[3 * k], green + b[k] * h[3 * k + 1], blue + b[k] * h[3 * k + 2]
        return red, green, blue

    @inner
    def forward_sixteen(i, harmonics, direction, colour):
        align_stack()
        store3(colour, 3 * i, summed(basis(load3(direction, 3 * i)), read(harmonics, i)))

    @inner
    def backward_sixteen(i, harmonics, direction, g_colour, d_harmonics, d_direction):
        align_stack()
        g, none = load3(g_colour, 3 * i), splat(np.float32(0))
        still = absolute(g[0]) + absolute(g[1]) + absolute(g[2]) <= none
        d, h = load3(direction, 3 * i), read(harmonics, i)
        d = (select(still, none, d[0]), select(still, none, d[1]), select(still, none, d[2]))
        write(d_harmonics, i, scaled(basis(d), g))
        s = slope(d, paired(h, g))
        store3(d_direction, 3 * i, (select(still, none, s[0]), select(still, none, s[1]), select(still, none, s[2])))

    @numba.njit(error_model="numpy")
    def forward(harmonics, direction, colour):
        for i in range(len(direction) // 3):
            total = summed(basis(_three(direction, 3 * i)), numbers(harmonics, 3 * count * i))
            for c in range(3):
                colour[3 * i + c] = total[c]

    @numba.njit(error_model="numpy")
    def backward(harmonics, direction, g_colour, d_harmonics, d_direction):
        for i in range(len(direction) // 3):
            d, g = _three(direction, 3 * i), _three(g_colour, 3 * i)
            if g[0] == 0 and g[1] == 0 and g[2] == 0:
                d_harmonics[3 * count * i : 3 * count * (i + 1)] = 0.0
                d_direction[3 * i : 3 * i + 3] = 0.0
                continue
            dh = scaled(basis(d), g)
            for k in range(3 * count):
                d_harmonics[3 * count * i + k] = dh[k]
            s = slope(d, paired(numbers(harmonics, 3 * count * i), g))
            for c in range(3):
                d_direction[3 * i + c] = s[c]

    return forward_sixteen, backward_sixteen, forward, backward


_forward1, _backward1, *_SCALARS1 = _kernels(1, _basis1, _slope1, _scaled1, _paired1, _load3, _store3)
_forward2, _backward2, *_SCALARS2 = _kernels(2, _basis2, _slope2, _scaled2, _paired2, _load8, _store8)
_forward3, _backward3, *_SCALARS3 = _kernels(3, _basis3, _slope3, _scaled3, _paired3, _load15, _store15)


# One function for each degree: a cached closure that holds compiled functions would be compiled in every process.


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _forward_vectors1(harmonics, direction, colour):
    n = len(direction) // 3
    for part in numba.prange((n + PART - 1) // PART):
        for start in range(part * PART, min((part + 1) * PART, n), WIDTH):
            _forward1(min(start, n - WIDTH), harmonics, direction, colour)


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _backward_vectors1(harmonics, direction, g_colour, d_harmonics, d_direction):
    n = len(direction) // 3
    for part in numba.prange((n + PART - 1) // PART):
        for start in range(part * PART, min((part + 1) * PART, n), WIDTH):
            _backward1(min(start, n - WIDTH), harmonics, direction, g_colour, d_harmonics, d_direction)


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _forward_vectors2(harmonics, direction, colour):
    n = len(direction) // 3
    for part in numba.prange((n + PART - 1) // PART):
        for start in range(part * PART, min((part + 1) * PART, n), WIDTH):
            _forward2(min(start, n - WIDTH), harmonics, direction, colour)


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _backward_vectors2(harmonics, direction, g_colour, d_harmonics, d_direction):
    n = len(direction) // 3
    for part in numba.prange((n + PART - 1) // PART):
        for start in range(part * PART, min((part + 1) * PART, n), WIDTH):
            _backward2(min(start, n - WIDTH), harmonics, direction, g_colour, d_harmonics, d_direction)


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _forward_vectors3(harmonics, direction, colour):
    n = len(direction) // 3
    for part in numba.prange((n + PART - 1) // PART):
        for start in range(part * PART, min((part + 1) * PART, n), WIDTH):
            _forward3(min(start, n - WIDTH), harmonics, direction, colour)


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _backward_vectors3(harmonics, direction, g_colour, d_harmonics, d_direction):
    n = len(direction) // 3
    for part in numba.prange((n + PART - 1) // PART):
        for start in range(part * PART, min((part + 1) * PART, n), WIDTH):
            _backward3(min(start, n - WIDTH), harmonics, direction, g_colour, d_harmonics, d_direction)


_KERNELS = {
    1: (_forward_vectors1, _backward_vectors1, *_SCALARS1),
    2: (_forward_vectors2, _backward_vectors2, *_SCALARS2),
    3: (_forward_vectors3, _backward_vectors3, *_SCALARS3),
}


def view_colour(
    harmonics: Float[Tensor, "n k 3"], direction: Float[Tensor, "n 3"], degree: int
) -> Float[Tensor, "n 3"]:
    """What the higher degrees add to the colour seen along `direction`: unit vectors from the eye to the surfel.

    Directions in the axes of the canonical head (`skinning.skin`) make the harmonics turn with it.
    """
    return _ViewColour.apply(harmonics, direction, degree)


class _ViewColour(torch.autograd.Function):
    @staticmethod
    def forward(ctx, harmonics, direction, degree):
        arrays = [t.detach().contiguous().numpy().reshape(-1) for t in (harmonics, direction)]
        ctx.kept, ctx.vectors = (arrays, degree), direction.dtype == torch.float32 and len(direction) >= WIDTH
        ctx.shapes = harmonics.shape, direction.shape
        colour = np.empty_like(arrays[1])
        forward_vectors, _, forward, _ = _KERNELS[degree]
        (forward_vectors if ctx.vectors else forward)(*arrays, colour)
        return torch.from_numpy(colour).view(direction.shape)

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, g_colour):
        arrays, degree = ctx.kept
        gradients = [np.empty_like(array) for array in arrays]
        _, backward_vectors, _, backward = _KERNELS[degree]
        kernel = backward_vectors if ctx.vectors else backward
        kernel(*arrays, g_colour.contiguous().numpy().reshape(-1), *gradients)
        return *(torch.from_numpy(d).view(s) for d, s in zip(gradients, ctx.shapes, strict=True)), None
