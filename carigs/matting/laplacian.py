"""The matting Laplacian of Levin, Lischinski and Weiss (2008) in a part of an image, and equations with it.

In each window of 3 x 3 pixels, alpha is taken for an affine function of the colour. The sum of the squared errors of
the best functions is a quadratic form in alpha, whose matrix couples pixels that share a window: each with those up to
two rows and columns away. Where few pixels are unknown, the matrix is kept as 25 coefficients for each of them.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from carigs.simd.kernels import INLINE, kernel

REACH = 2
"""Rows and columns between pixels that share a window."""
SIDE = 2 * REACH + 1


@kernel
def coefficients(image, number, count, epsilon):
    """The rows of the Laplacian for unknown pixels.

    Args:
        image: Colours (h, w, 3) in [0, 1], float32.
        number: Number of each pixel among the unknown ones (h, w), int32; -1 for the others.
        count: Number of unknown pixels n.
        epsilon: Regularisation of the windows' covariances, times their nine pixels.

    Returns:
        Coefficients (5, 5, n) of the pixels around each, float32.
    """
    height, width = number.shape
    result = np.zeros((SIDE, SIDE, count), np.float32)
    colours, products = np.empty((9, 3)), np.empty((9, 3))
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            unknown = False
            for j in range(-1, 2):
                for i in range(-1, 2):
                    unknown |= number[y + j, x + i] >= 0
            if not unknown:
                continue
            mean_r, mean_g, mean_b = 0.0, 0.0, 0.0
            for j in range(3):
                for i in range(3):
                    for c in range(3):
                        colours[3 * j + i, c] = image[y + j - 1, x + i - 1, c]
                    mean_r += colours[3 * j + i, 0] / 9
                    mean_g += colours[3 * j + i, 1] / 9
                    mean_b += colours[3 * j + i, 2] / 9
            rr, rg, rb, gg, gb, bb = epsilon / 9, 0.0, 0.0, epsilon / 9, 0.0, epsilon / 9
            for k in range(9):
                colours[k, 0] -= mean_r
                colours[k, 1] -= mean_g
                colours[k, 2] -= mean_b
                r, g, b = colours[k, 0], colours[k, 1], colours[k, 2]
                rr += r * r / 9
                rg += r * g / 9
                rb += r * b / 9
                gg += g * g / 9
                gb += g * b / 9
                bb += b * b / 9
            # The inverse of the covariance by its cofactors.
            inverse_rr, inverse_rg, inverse_rb = gg * bb - gb * gb, rb * gb - rg * bb, rg * gb - rb * gg
            inverse_gg, inverse_gb, inverse_bb = rr * bb - rb * rb, rg * rb - rr * gb, rr * gg - rg * rg
            scale = 1 / (rr * inverse_rr + rg * inverse_rg + rb * inverse_rb)
            for k in range(9):
                r, g, b = scale * colours[k, 0], scale * colours[k, 1], scale * colours[k, 2]
                products[k, 0] = inverse_rr * r + inverse_rg * g + inverse_rb * b
                products[k, 1] = inverse_rg * r + inverse_gg * g + inverse_gb * b
                products[k, 2] = inverse_rb * r + inverse_gb * g + inverse_bb * b
            for k in range(9):
                n = number[y + k // 3 - 1, x + k % 3 - 1]
                if n < 0:
                    continue
                for m in range(9):
                    product = 0.0
                    for c in range(3):
                        product += products[k, c] * colours[m, c]
                    value = np.float64(k == m) - (1 + product) / 9
                    result[m // 3 - k // 3 + REACH, m % 3 - k % 3 + REACH, n] += value
    return result


@njit(**INLINE)
def _multiply(matrix, runs, values, result):
    """The product (n) of the matrix and an image (h + 4, w + 4)."""
    for k in range(len(runs)):
        y, x, first, length = runs[k]
        part = result[first : first + length]
        part[:] = 0
        for j in range(SIDE):
            for i in range(SIDE):
                factors = matrix[j, i, first : first + length]
                seen = values[y + j, x + i : x + i + length]
                for n in range(length):
                    part[n] += factors[n] * seen[n]


@njit(**INLINE)
def _into_image(runs, values, image):
    """Put values (n) of unknown pixels into an image (h + 4, w + 4)."""
    for k in range(len(runs)):
        y, x, first, length = runs[k]
        for n in range(length):
            image[y + REACH, x + REACH + n] = values[first + n]


@kernel
def solve(matrix, runs, alpha, right, tolerance, iterations):
    """Solve for alpha by conjugate gradients with the matrix's diagonal as preconditioner.

    Args:
        matrix: Coefficients (5, 5, n), positive definite.
        runs: Of each run of unknown pixels in a row (r, 4): row, first column, number of the first pixel, and length.
        alpha: First guess of the unknown pixels and alpha of the known ones, with a border of two pixels
            (h + 4, w + 4), float32; it is changed.
        right: Right side for the unknown pixels (n), float32.
        tolerance: Root mean square of the residuals, over the diagonal, at which iterations end.
        iterations: Their largest number.

    Returns:
        Their number.
    """
    count = len(right)
    diagonal = matrix[REACH, REACH]
    solution, product, residual = np.empty_like(right), np.empty_like(right), np.empty_like(right)
    direction, directions = np.empty_like(right), np.zeros_like(alpha)
    for k in range(len(runs)):
        y, x, first, length = runs[k]
        solution[first : first + length] = alpha[y + REACH, x + REACH : x + REACH + length]
    _multiply(matrix, runs, alpha, product)
    fall = 0.0  # r . z, with z = r / diagonal
    for n in range(count):
        residual[n] = right[n] - product[n]
        direction[n] = residual[n] / diagonal[n]
        fall += np.float64(residual[n]) * direction[n]
    done = 0
    while done < iterations:
        done += 1
        _into_image(runs, direction, directions)
        _multiply(matrix, runs, directions, product)
        curvature = 0.0
        for n in range(count):
            curvature += np.float64(direction[n]) * product[n]
        if curvature <= 0:
            break
        length = np.float32(fall / curvature)
        before, fall, square = fall, 0.0, 0.0
        for n in range(count):
            solution[n] += length * direction[n]
            residual[n] -= length * product[n]
            step = residual[n] / diagonal[n]
            fall += np.float64(residual[n]) * step
            square += np.float64(step) * step
        if square <= tolerance * tolerance * count:
            break
        share = np.float32(fall / before)
        for n in range(count):
            direction[n] = residual[n] / diagonal[n] + share * direction[n]
    _into_image(runs, solution, alpha)
    return done
