"""L1 and SSIM of two images and their gradient in one pass over the pixels.

SSIM as Wang et al. 2004: 11 Gaussian taps of sigma 1.5, C1 = 0.01^2, C2 = 0.03^2, zero padding, mean over pixels and
channels. With G the filter, m = G x, n = G y:

    A1 = 2 m n + C1    A2 = 2 (G(xy) - m n) + C2    B1 = m^2 + n^2 + C1    B2 = G(x^2) - m^2 + G(y^2) - n^2 + C2
    S = A1 A2 / (B1 B2)
    dS/dG(xy) = 2 A1 / (B1 B2)     dS/dG(x^2) = -S / B2
    dS/dm = 2 n (A2 - A1) / (B1 B2) - 2 m S (1/B1 - 1/B2)
    d(sum S)/dx = G(dS/dm) + 2 x G(dS/dG(x^2)) + y G(dS/dG(xy))          (G is symmetric)

Strips of rows are independent tasks; their sums are added in order, so the number of threads does not matter. Within a
strip moments, derivative maps and gradient follow each other at a distance of five rows, to stay in the cache.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Bool, Float32

from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.memory import align_stack, load, store
from carigs.simd.reductions import reduce_add
from carigs.simd.tuples import add, componentwise, multiply
from carigs.simd.vector_math import absolute, select
from carigs.simd.vectors import WIDTH, broadcast, simd_inline, simd_inline_alloc

RADIUS = 5
C1, C2, ZERO, ONE, TWO = np.float32(0.01**2), np.float32(0.03**2), np.float32(0), np.float32(1), np.float32(2)
STRIP = 96  # rows per task; 10 more on either side are filtered again
BLOCK = 4  # rows that are filtered down the columns together: 14 loads give 4 results
RING = 16  # rows of moments and of maps in memory: the 14 that a block needs, rounded up to a power of two
LEFT = 16  # zeros on the left of every row; 48 and more on its right

_taps = np.exp(-(np.arange(-RADIUS, RADIUS + 1) ** 2) / (2 * 1.5**2))
T0, T1, T2, T3, T4, T5 = (_taps / _taps.sum()).astype(np.float32)[: RADIUS + 1]  # the other half mirrors these


_load, _store, _select, _sums = (componentwise(function) for function in (load, store, select, reduce_add))
TAPS = tuple(range(-RADIUS, RADIUS + 1))
WINDOW = tuple(range(BLOCK + 2 * RADIUS))  # the rows that the filter of a block needs, from the topmost one


@simd_inline
def _filtered(v):
    return (
        T0 * (v[0] + v[10])
        + T1 * (v[1] + v[9])
        + T2 * (v[2] + v[8])
        + T3 * (v[3] + v[7])
        + T4 * (v[4] + v[6])
        + T5 * v[5]
    )


@simd_inline
def _across(row, at):
    """Filter sixteen elements along a row."""
    return _filtered(_load(row, add(at, TAPS)))


@simd_inline
def _tap(x, y, at, weight, sums):
    m, n, squares, product = sums
    a, b = load(x, at), load(y, at)
    u, v = weight * a, weight * b
    return m + u, n + v, squares + u * a + v * b, product + u * b


@simd_inline
def _moments_across(x, y, at):
    """Filter x, y, x^2 + y^2 (B2 has only this sum) and x y along a row; the products are cheaper than their loads."""
    zero = broadcast(ZERO)
    sums = _tap(x, y, at - 5, T0, (zero, zero, zero, zero))
    sums = _tap(x, y, at + 5, T0, _tap(x, y, at - 4, T1, sums))
    sums = _tap(x, y, at + 4, T1, _tap(x, y, at - 3, T2, sums))
    sums = _tap(x, y, at + 3, T2, _tap(x, y, at - 2, T3, sums))
    sums = _tap(x, y, at + 2, T3, _tap(x, y, at - 1, T4, sums))
    return _tap(x, y, at + 1, T4, _tap(x, y, at, T5, sums))


@simd_inline
def _offset(plane, row, stride, at):
    return (plane * RING + (row & (RING - 1))) * stride + at


_offsets = componentwise(_offset)


@simd_inline
def _down(ring, plane, first, stride, at):
    """Filter a block of rows down the columns; `first` is the topmost row that the filter of the first row needs."""
    v = _load(ring, _offsets(plane, add(first, WINDOW), stride, at))
    return _filtered(v[0:11]), _filtered(v[1:12]), _filtered(v[2:13]), _filtered(v[3:14])


_down_planes = componentwise(_down)


@simd_inline
def _similarity(m, n, squares, product):
    """S, and its derivatives with respect to m, G(x^2) and G(xy)."""
    mn, mm_nn = m * n, m * m + n * n
    a1, a2 = TWO * mn + C1, TWO * (product - mn) + C2
    b1, b2 = mm_nn + C1, squares - mm_nn + C2
    inverse = ONE / (b1 * b2)
    i1, i2 = b2 * inverse, b1 * inverse
    s = a1 * a2 * inverse
    return s, (TWO * (n * (a2 - a1) * inverse - m * s * (i1 - i2)), broadcast(ZERO) - s * i2, TWO * a1 * inverse)


@simd_inline
def _map_row(maps, r, stride, at, height, inside, m, n, squares, product):
    """Store the derivatives, 0 outside the image; returns S."""
    zero, offsets = broadcast(ZERO), _offsets((0, 1, 2), r, stride, at)
    if r < 0 or r >= height:
        _store(maps, offsets, zero)
        return zero
    s, derivatives = _similarity(m, n, squares, product)
    _store(maps, offsets, _select(inside, derivatives, zero))
    return select(inside, s, zero)


_map_block = componentwise(_map_row)


@simd_inline
def _fill(rows, stride, x, y, valid, c, r, f0, f1, at):
    """Copy a row of x, of y (x where y is not valid), and of 1 where y is valid, else 0."""
    x_row, y_row, valid_row = x[c, r, f0:f1], y[c, r, f0:f1], valid[r, f0:f1]
    a_row, b_row, v_row = rows[at:], rows[stride + at :], rows[2 * stride + at :]
    for q in range(f1 - f0):
        a = x_row[q]
        a_row[q] = a
        b_row[q] = y_row[q] if valid_row[q] else a
        v_row[q] = ONE if valid_row[q] else ZERO


@simd_inline
def _equal(x, y, at):
    """Whether sixteen elements are equal; NaN equals nothing."""
    return reduce_add(select(absolute(load(x, at) - load(y, at)) <= ZERO, broadcast(ZERO), broadcast(ONE))) == ZERO


@simd_inline
def _columns_with_difference(x, y, valid, c, h0, h1):
    """Find the first column with a difference in these rows, and the column after the last."""
    _, height, width = x.shape
    a, b = x.reshape(-1), y.reshape(-1)
    c0, c1 = width, 0
    for r in range(h0, h1):
        at, q = (c * height + r) * width, 0
        while q < c0:
            if q + WIDTH <= c0 and _equal(a, b, at + q):
                q += WIDTH
            elif a[at + q] == b[at + q] or not valid[r, q]:
                q += 1
            else:
                break
        c0, q = q, width
        while q > c1:
            if q - WIDTH >= c1 and _equal(a, b, at + q - WIDTH):
                q -= WIDTH
            elif a[at + q - 1] == b[at + q - 1] or not valid[r, q - 1]:
                q -= 1
            else:
                break
        c1 = q
    return c0, c1


@simd_inline
def _moment_row(moments, rows, r, stride, mapped):
    for at in range(LEFT, LEFT + mapped, WIDTH):
        _store(moments, _offsets((0, 1, 2, 3), r, stride, at), _moments_across(rows, rows[stride:], at))


@simd_inline
def _map_rows(maps, moments, inside, top, stride, mapped, height):
    """Compute the derivative maps of a block of rows; returns the sum of S of each row."""
    zero = broadcast(ZERO)
    s = (zero, zero, zero, zero)
    for at in range(LEFT, LEFT + mapped, WIDTH):
        m, n, squares, product = _down_planes(moments, (0, 1, 2, 3), top - RADIUS, stride, at)
        rows, is_inside = add(top, (0, 1, 2, 3)), load(inside, at) > ZERO
        s = add(s, _map_block(maps, rows, stride, at, height, is_inside, m, n, squares, product))
    return _sums(s)


@simd_inline
def _maps_down(slopes, maps, top, stride, mapped):
    for at in range(LEFT, LEFT + mapped, WIDTH):
        for plane in range(3):
            offsets = add(plane * BLOCK * stride + at, multiply(stride, (0, 1, 2, 3)))
            _store(slopes, offsets, _down(maps, plane, top - RADIUS, stride, at))


@simd_inline
def _gradient_row(result, rows, slopes, j, stride, begin, stop, l1_weight, ssim_weight):
    """Compute the gradient of row j of the block; returns the sum of |x - y|."""
    one, difference = broadcast(ONE), broadcast(ZERO)
    for at in range(begin, stop, WIDTH):
        a, b, counts = load(rows, at), load(rows, stride + at), load(rows, 2 * stride + at)
        slope = _across(slopes, j * stride + at) + TWO * a * _across(slopes, (BLOCK + j) * stride + at)
        slope += b * _across(slopes, (2 * BLOCK + j) * stride + at)
        step = select(a > b, one, select(a < b, ZERO - one, ZERO))
        difference += absolute(a - b)
        store(result, at, counts * (l1_weight * step - ssim_weight * slope))
    return reduce_add(difference)


@simd_inline_alloc
def _strip(task, x, y, valid, l1_weight, ssim_weight, gradient, strips, differences, similarities):
    """Sum |x - y| and S over a strip of one channel, and write its part of the gradient."""
    align_stack()
    _, height, width = x.shape
    c, r0 = task // strips, (task % strips) * STRIP
    r1 = min(r0 + STRIP, height)
    # Where x = y, S = 1, and the contributions of such pixels to the gradient of others cancel: only columns with a
    # difference, and those within the reach of the filter, are computed.
    c0, c1 = _columns_with_difference(x, y, valid, c, max(r0 - 2 * RADIUS, 0), min(r1 + 2 * RADIUS, height))
    for r in range(r0, r1):
        gradient[c, r, :] = ZERO
    if c1 <= c0:
        differences[task], similarities[task] = 0.0, float((r1 - r0) * width)
        return
    f0, f1 = max(c0 - 2 * RADIUS, 0), min(c1 + 2 * RADIUS, width)  # columns with a gradient
    d0, d1 = max(c0 - RADIUS, 0), min(c1 + RADIUS, width)  # columns with derivative maps; the first is stored at LEFT
    mapped, begin, stop = d1 - d0, LEFT + f0 - d0, LEFT + f1 - d0
    stride = LEFT + (mapped + WIDTH - 1) // WIDTH * WIDTH + 3 * WIDTH
    moments, maps = np.zeros(4 * RING * stride, np.float32), np.zeros(3 * RING * stride, np.float32)
    rows, slopes = np.zeros(3 * stride, np.float32), np.zeros(3 * BLOCK * stride, np.float32)
    inside, result = np.zeros(stride, np.float32), np.empty(stride, np.float32)
    inside[LEFT : LEFT + mapped] = ONE
    similarity, difference = 0.0, 0.0
    # Moments of a block of rows, then the maps of the block 5 rows above, then the gradient of the block 10 rows above.
    for top in range(r0 - 2 * RADIUS, r1 + 2 * RADIUS, BLOCK):
        for r in range(top, top + BLOCK):
            if 0 <= r < height:
                _fill(rows, stride, x, y, valid, c, r, f0, f1, begin)
            else:
                rows[: 2 * stride] = ZERO
            _moment_row(moments, rows, r, stride, mapped)
        sums = _map_rows(maps, moments, inside, top - RADIUS, stride, mapped, height)
        for j in range(BLOCK):
            if r0 <= top - RADIUS + j < r1:
                similarity += sums[j] + float(width - mapped)
        _maps_down(slopes, maps, top - 2 * RADIUS, stride, mapped)
        for j in range(BLOCK):
            r = top - 2 * RADIUS + j
            if r0 <= r < r1:
                _fill(rows, stride, x, y, valid, c, r, f0, f1, begin)
                difference += _gradient_row(result, rows, slopes, j, stride, begin, stop, l1_weight, ssim_weight)
                row = gradient[c, r, f0:f1]
                for q in range(f1 - f0):  # the assignment of a slice takes two seconds to compile
                    row[q] = result[begin + q]
    differences[task], similarities[task] = difference, similarity


@kernel
def _l1_and_ssim(x, y, valid, l1_weight, ssim_weight):
    """Sums over all pixels of |x - y| and of S, and the gradient of l1_weight sum|x - y| - ssim_weight sum S."""
    channels, height, _ = x.shape
    strips = (height + STRIP - 1) // STRIP
    tasks, gradient = channels * strips, np.empty_like(x)
    difference, similarity = np.empty(tasks), np.empty(tasks)
    parallel_for(_strip, tasks, (x, y, valid, l1_weight, ssim_weight, gradient, strips, difference, similarity))
    return difference.sum(), similarity.sum(), gradient


def l1_ssim_loss(
    x: Float32[np.ndarray, "c h w"],
    y: Float32[np.ndarray, "c h w"],
    valid: Bool[np.ndarray, "h w"],
    ssim_weight: float,
) -> tuple[float, Float32[np.ndarray, "c h w"]]:
    """L1 and SSIM loss (1 - lambda) mean |x - y| + lambda (1 - mean SSIM), lambda = `ssim_weight`, and its gradient.

    Args:
        x: Channels of the rendered image.
        y: Channels of the target; replaced by x where `valid` is false.
        valid: Pixels that supervise.
        ssim_weight: Weight lambda of the SSIM term.

    Returns:
        Value, and gradient with respect to x: 0 where `valid` is false.
    """
    weights = np.float32((1 - ssim_weight) / x.size), np.float32(ssim_weight / x.size)
    difference, similarity, gradient = _l1_and_ssim(x, y, valid, *weights)
    return (1 - ssim_weight) * difference / x.size + ssim_weight * (1 - similarity / x.size), gradient
