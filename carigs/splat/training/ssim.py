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
from carigs.simd.vector_math import absolute, select, total
from carigs.simd.vectors import WIDTH, broadcast, simd_inline, simd_inline_alloc

RADIUS = 5
C1, C2, ZERO, ONE, TWO = np.float32(0.01**2), np.float32(0.03**2), np.float32(0), np.float32(1), np.float32(2)
STRIP = 96  # rows per task; 10 more on either side are filtered again
BLOCK = 4  # rows that are filtered down the columns together: 14 loads give 4 results
RING = 16  # rows of moments and of maps in memory: the 14 that a block needs, rounded up to a power of two
LEFT = 16  # zeros on the left of every row; 48 and more on its right

_taps = np.exp(-(np.arange(-RADIUS, RADIUS + 1) ** 2) / (2 * 1.5**2))
T0, T1, T2, T3, T4, T5 = (_taps / _taps.sum()).astype(np.float32)[: RADIUS + 1]  # the other half mirrors these


@simd_inline
def _filtered(v0, v1, v2, v3, v4, v5, v6, v7, v8, v9, v10):
    return T0 * (v0 + v10) + T1 * (v1 + v9) + T2 * (v2 + v8) + T3 * (v3 + v7) + T4 * (v4 + v6) + T5 * v5


@simd_inline
def _across(row, at):
    """Filter sixteen elements along a row."""
    return _filtered(
        load(row, at - 5), load(row, at - 4), load(row, at - 3), load(row, at - 2), load(row, at - 1), load(row, at),
        load(row, at + 1), load(row, at + 2), load(row, at + 3), load(row, at + 4), load(row, at + 5),
    )  # fmt: skip


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
def _down(ring, plane, first, stride, at):
    """Filter a block of rows down the columns; `first` is the topmost row that the filter of the first row needs."""
    v0, v1 = _ring_row(ring, plane, first, stride, at), _ring_row(ring, plane, first + 1, stride, at)
    v2, v3 = _ring_row(ring, plane, first + 2, stride, at), _ring_row(ring, plane, first + 3, stride, at)
    v4, v5 = _ring_row(ring, plane, first + 4, stride, at), _ring_row(ring, plane, first + 5, stride, at)
    v6, v7 = _ring_row(ring, plane, first + 6, stride, at), _ring_row(ring, plane, first + 7, stride, at)
    v8, v9 = _ring_row(ring, plane, first + 8, stride, at), _ring_row(ring, plane, first + 9, stride, at)
    v10, v11 = _ring_row(ring, plane, first + 10, stride, at), _ring_row(ring, plane, first + 11, stride, at)
    v12, v13 = _ring_row(ring, plane, first + 12, stride, at), _ring_row(ring, plane, first + 13, stride, at)
    return (
        _filtered(v0, v1, v2, v3, v4, v5, v6, v7, v8, v9, v10),
        _filtered(v1, v2, v3, v4, v5, v6, v7, v8, v9, v10, v11),
        _filtered(v2, v3, v4, v5, v6, v7, v8, v9, v10, v11, v12),
        _filtered(v3, v4, v5, v6, v7, v8, v9, v10, v11, v12, v13),
    )


@simd_inline
def _offset(plane, row, stride):
    return (plane * RING + (row & (RING - 1))) * stride


@simd_inline
def _ring_row(ring, plane, row, stride, at):
    return load(ring, _offset(plane, row, stride) + at)


@simd_inline
def _similarity(m, n, squares, product):
    """S and its derivatives with respect to m, G(x^2) and G(xy)."""
    mn, mm_nn = m * n, m * m + n * n
    a1, a2 = TWO * mn + C1, TWO * (product - mn) + C2
    b1, b2 = mm_nn + C1, squares - mm_nn + C2
    inverse = ONE / (b1 * b2)
    i1, i2 = b2 * inverse, b1 * inverse
    s = a1 * a2 * inverse
    return s, TWO * (n * (a2 - a1) * inverse - m * s * (i1 - i2)), broadcast(ZERO) - s * i2, TWO * a1 * inverse


@simd_inline
def _map_row(maps, r, stride, at, height, inside, m, n, squares, product):
    """Store the derivatives, 0 outside the image; returns S."""
    if r < 0 or r >= height:
        store(maps, _offset(0, r, stride) + at, broadcast(ZERO))
        store(maps, _offset(1, r, stride) + at, broadcast(ZERO))
        store(maps, _offset(2, r, stride) + at, broadcast(ZERO))
        return broadcast(ZERO)
    zero = broadcast(ZERO)
    s, by_m, by_square, by_product = _similarity(m, n, squares, product)
    store(maps, _offset(0, r, stride) + at, select(inside, by_m, zero))
    store(maps, _offset(1, r, stride) + at, select(inside, by_square, zero))
    store(maps, _offset(2, r, stride) + at, select(inside, by_product, zero))
    return select(inside, s, zero)


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
    return total(select(absolute(load(x, at) - load(y, at)) <= ZERO, broadcast(ZERO), broadcast(ONE))) == ZERO


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
        m, n, squares, product = _moments_across(rows, rows[stride:], at)
        store(moments, _offset(0, r, stride) + at, m)
        store(moments, _offset(1, r, stride) + at, n)
        store(moments, _offset(2, r, stride) + at, squares)
        store(moments, _offset(3, r, stride) + at, product)


@simd_inline
def _map_rows(maps, moments, inside, top, stride, mapped, height):
    """Compute the derivative maps of a block of rows; returns the sum of S of each row."""
    s0 = s1 = s2 = s3 = broadcast(ZERO)
    for at in range(LEFT, LEFT + mapped, WIDTH):
        m, n = _down(moments, 0, top - RADIUS, stride, at), _down(moments, 1, top - RADIUS, stride, at)
        squares, product = _down(moments, 2, top - RADIUS, stride, at), _down(moments, 3, top - RADIUS, stride, at)
        is_inside = load(inside, at) > ZERO
        s0 += _map_row(maps, top, stride, at, height, is_inside, m[0], n[0], squares[0], product[0])
        s1 += _map_row(maps, top + 1, stride, at, height, is_inside, m[1], n[1], squares[1], product[1])
        s2 += _map_row(maps, top + 2, stride, at, height, is_inside, m[2], n[2], squares[2], product[2])
        s3 += _map_row(maps, top + 3, stride, at, height, is_inside, m[3], n[3], squares[3], product[3])
    return total(s0), total(s1), total(s2), total(s3)


@simd_inline
def _maps_down(slopes, maps, top, stride, mapped):
    for at in range(LEFT, LEFT + mapped, WIDTH):
        for plane in range(3):
            r0, r1, r2, r3 = _down(maps, plane, top - RADIUS, stride, at)
            store(slopes, plane * BLOCK * stride + at, r0)
            store(slopes, (plane * BLOCK + 1) * stride + at, r1)
            store(slopes, (plane * BLOCK + 2) * stride + at, r2)
            store(slopes, (plane * BLOCK + 3) * stride + at, r3)


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
    return total(difference)


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
