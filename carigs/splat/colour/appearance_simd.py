"""The kernels of `appearance` for float32, sixteen surfels at a time; the last sixteen overlap the ones before."""

from __future__ import annotations

import numpy as np

from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.memory import align_stack, load3, load9, load_rows, store3, store9, store_rows
from carigs.simd.vector_math import absolute, select
from carigs.simd.vectors import WIDTH, broadcast, simd_inline, simd_inline_alloc
from carigs.splat.colour.spherical_harmonics import BASIS, PAIRED, SCALED, SH_BASE, SLOPE, coefficients

PART = 1024  # surfels of one task


@simd_inline
def _factors(i, shade, binding, factor):
    """Of the light, on sixteen surfels; `factor` holds 48 ones."""
    if len(shade) > 0:
        for r in range(WIDTH):
            f = 3 * np.int64(binding[i + r])
            factor[3 * r], factor[3 * r + 1], factor[3 * r + 2] = shade[f], shade[f + 1], shade[f + 2]
    return load3(factor, 0)


@simd_inline
def _shown(dc, more, factor, none):
    """NaN stays NaN: the rasteriser leaves such surfels out."""
    red, green, blue = (
        (0.5 + SH_BASE * dc[0] + more[0]) * factor[0], (0.5 + SH_BASE * dc[1] + more[1]) * factor[1],
        (0.5 + SH_BASE * dc[2] + more[2]) * factor[2],
    )  # fmt: skip
    return select(red < none, none, red), select(green < none, none, green), select(blue < none, none, blue)


@simd_inline
def _through(colour, factor, g, none):
    """The gradient before the factor and the clamp."""
    return (
        select(colour[0] > none, factor[0] * g[0], none), select(colour[1] > none, factor[1] * g[1], none),
        select(colour[2] > none, factor[2] * g[2], none),
    )  # fmt: skip


@simd_inline
def _forward0(i, binding, base, harmonics, direction, shade, colour, factor):
    align_stack()
    none = broadcast(np.float32(0))
    factors = _factors(i, shade, binding, factor)
    store3(colour, 3 * i, _shown(load3(base, 3 * i), (none, none, none), factors, none))


@simd_inline
def _backward0(
    i, binding, base, harmonics, direction, shade, colour, g_colour, d_base, d_harmonics, d_direction, factor
):
    align_stack()
    factors = _factors(i, shade, binding, factor)
    g = _through(load3(colour, 3 * i), factors, load3(g_colour, 3 * i), broadcast(np.float32(0)))
    store3(d_base, 3 * i, (SH_BASE * g[0], SH_BASE * g[1], SH_BASE * g[2]))


@simd_inline
def _load8(array, i):
    a, b = load_rows(array, 24 * i, 24), load_rows(array, 24 * i + 8, 24)
    return (*a, *b[8:16])


@simd_inline
def _store8(array, i, h):
    store_rows(array, 24 * i + 8, 24, h[8:24])
    store_rows(array, 24 * i, 24, h[0:16])


@simd_inline
def _load15(array, i):
    a, b, c = load_rows(array, 45 * i, 45), load_rows(array, 45 * i + 16, 45), load_rows(array, 45 * i + 29, 45)
    return (*a, *b, *c[3:16])


@simd_inline
def _store15(array, i, h):
    store_rows(array, 45 * i + 29, 45, h[29:45])
    store_rows(array, 45 * i + 16, 45, h[16:32])
    store_rows(array, 45 * i, 45, h[0:16])


@simd_inline
def _load3(array, i):
    return load9(array, 9 * i)


@simd_inline
def _store3(array, i, h):
    store9(array, 9 * i, h)


def _sixteen(degree, read, write):
    """Forward and backward of one degree for vectors."""
    count, basis, slope = coefficients(degree), BASIS[degree], SLOPE[degree]
    scaled, paired = SCALED[degree], PAIRED[degree]

    @simd_inline
    def forward(i, binding, base, harmonics, direction, shade, colour, factor):
        align_stack()
        b, h = basis(load3(direction, 3 * i)), read(harmonics, i)
        red, green, blue = b[0] * h[0], b[0] * h[1], b[0] * h[2]
        for k in range(1, count):
            red, green, blue = red + b[k] * h[3 * k], green + b[k] * h[3 * k + 1], blue + b[k] * h[3 * k + 2]
        factors = _factors(i, shade, binding, factor)
        store3(colour, 3 * i, _shown(load3(base, 3 * i), (red, green, blue), factors, broadcast(np.float32(0))))

    @simd_inline
    def backward(
        i, binding, base, harmonics, direction, shade, colour, g_colour, d_base, d_harmonics, d_direction, factor
    ):
        align_stack()
        none = broadcast(np.float32(0))
        g = _through(load3(colour, 3 * i), _factors(i, shade, binding, factor), load3(g_colour, 3 * i), none)
        store3(d_base, 3 * i, (SH_BASE * g[0], SH_BASE * g[1], SH_BASE * g[2]))
        still = absolute(g[0]) + absolute(g[1]) + absolute(g[2]) <= none
        d, h = load3(direction, 3 * i), read(harmonics, i)
        d = (select(still, none, d[0]), select(still, none, d[1]), select(still, none, d[2]))
        write(d_harmonics, i, scaled(basis(d), g))
        s = slope(d, paired(h, g))
        store3(d_direction, 3 * i, (select(still, none, s[0]), select(still, none, s[1]), select(still, none, s[2])))

    return forward, backward


_forward1, _backward1 = _sixteen(1, _load3, _store3)
_forward2, _backward2 = _sixteen(2, _load8, _store8)
_forward3, _backward3 = _sixteen(3, _load15, _store15)

# Functions by name for each degree: a cached closure that holds compiled functions would be compiled in every process.


@simd_inline_alloc
def _forward_part0(part, binding, base, harmonics, direction, shade, colour):
    factor = np.ones(3 * WIDTH, np.float32)
    for start in range(part * PART, min((part + 1) * PART, len(binding)), WIDTH):
        _forward0(min(start, len(binding) - WIDTH), binding, base, harmonics, direction, shade, colour, factor)


@kernel
def _forward_vectors0(binding, *arguments):
    parallel_for(_forward_part0, (len(binding) + PART - 1) // PART, (binding, *arguments))


@simd_inline_alloc
def _backward_part0(
    part, binding, base, harmonics, direction, shade, colour, g_colour, d_base, d_harmonics, d_direction
):  # fmt: skip
    factor = np.ones(3 * WIDTH, np.float32)
    for start in range(part * PART, min((part + 1) * PART, len(binding)), WIDTH):
        _backward0(
            min(start, len(binding) - WIDTH), binding, base, harmonics, direction, shade, colour, g_colour, d_base,
            d_harmonics, d_direction, factor,
        )  # fmt: skip


@kernel
def _backward_vectors0(binding, *arguments):
    parallel_for(_backward_part0, (len(binding) + PART - 1) // PART, (binding, *arguments))


@simd_inline_alloc
def _forward_part1(part, binding, base, harmonics, direction, shade, colour):
    factor = np.ones(3 * WIDTH, np.float32)
    for start in range(part * PART, min((part + 1) * PART, len(binding)), WIDTH):
        _forward1(min(start, len(binding) - WIDTH), binding, base, harmonics, direction, shade, colour, factor)


@kernel
def _forward_vectors1(binding, *arguments):
    parallel_for(_forward_part1, (len(binding) + PART - 1) // PART, (binding, *arguments))


@simd_inline_alloc
def _backward_part1(
    part, binding, base, harmonics, direction, shade, colour, g_colour, d_base, d_harmonics, d_direction
):  # fmt: skip
    factor = np.ones(3 * WIDTH, np.float32)
    for start in range(part * PART, min((part + 1) * PART, len(binding)), WIDTH):
        _backward1(
            min(start, len(binding) - WIDTH), binding, base, harmonics, direction, shade, colour, g_colour, d_base,
            d_harmonics, d_direction, factor,
        )  # fmt: skip


@kernel
def _backward_vectors1(binding, *arguments):
    parallel_for(_backward_part1, (len(binding) + PART - 1) // PART, (binding, *arguments))


@simd_inline_alloc
def _forward_part2(part, binding, base, harmonics, direction, shade, colour):
    factor = np.ones(3 * WIDTH, np.float32)
    for start in range(part * PART, min((part + 1) * PART, len(binding)), WIDTH):
        _forward2(min(start, len(binding) - WIDTH), binding, base, harmonics, direction, shade, colour, factor)


@kernel
def _forward_vectors2(binding, *arguments):
    parallel_for(_forward_part2, (len(binding) + PART - 1) // PART, (binding, *arguments))


@simd_inline_alloc
def _backward_part2(
    part, binding, base, harmonics, direction, shade, colour, g_colour, d_base, d_harmonics, d_direction
):  # fmt: skip
    factor = np.ones(3 * WIDTH, np.float32)
    for start in range(part * PART, min((part + 1) * PART, len(binding)), WIDTH):
        _backward2(
            min(start, len(binding) - WIDTH), binding, base, harmonics, direction, shade, colour, g_colour, d_base,
            d_harmonics, d_direction, factor,
        )  # fmt: skip


@kernel
def _backward_vectors2(binding, *arguments):
    parallel_for(_backward_part2, (len(binding) + PART - 1) // PART, (binding, *arguments))


@simd_inline_alloc
def _forward_part3(part, binding, base, harmonics, direction, shade, colour):
    factor = np.ones(3 * WIDTH, np.float32)
    for start in range(part * PART, min((part + 1) * PART, len(binding)), WIDTH):
        _forward3(min(start, len(binding) - WIDTH), binding, base, harmonics, direction, shade, colour, factor)


@kernel
def _forward_vectors3(binding, *arguments):
    parallel_for(_forward_part3, (len(binding) + PART - 1) // PART, (binding, *arguments))


@simd_inline_alloc
def _backward_part3(
    part, binding, base, harmonics, direction, shade, colour, g_colour, d_base, d_harmonics, d_direction
):  # fmt: skip
    factor = np.ones(3 * WIDTH, np.float32)
    for start in range(part * PART, min((part + 1) * PART, len(binding)), WIDTH):
        _backward3(
            min(start, len(binding) - WIDTH), binding, base, harmonics, direction, shade, colour, g_colour, d_base,
            d_harmonics, d_direction, factor,
        )  # fmt: skip


@kernel
def _backward_vectors3(binding, *arguments):
    parallel_for(_backward_part3, (len(binding) + PART - 1) // PART, (binding, *arguments))


KERNELS = (
    (_forward_vectors0, _backward_vectors0), (_forward_vectors1, _backward_vectors1),
    (_forward_vectors2, _backward_vectors2), (_forward_vectors3, _backward_vectors3),
)  # fmt: skip
"""By degree: forward and backward."""
