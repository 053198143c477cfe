"""3x3 matrices inside Numba kernels: tuples of nine numbers, row by row. Small arrays would be allocated on the heap.

The numbers are scalars or, in functions without branches, vectors of `carigs.simd.vectors` with one matrix per lane.
"""

from __future__ import annotations

import math

from carigs.simd.tuples import matrix_vector
from carigs.simd.vectors import scalar_or_simd

IDENTITY = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)


@scalar_or_simd
def load(array, i):
    """Matrix `array[i]`.

    Args:
        array: Matrices (n, 3, 3).
        i: Index.

    Returns:
        Nine numbers, row by row.
    """
    return (array[i, 0, 0], array[i, 0, 1], array[i, 0, 2], array[i, 1, 0], array[i, 1, 1],
            array[i, 1, 2], array[i, 2, 0], array[i, 2, 1], array[i, 2, 2])  # fmt: skip


@scalar_or_simd
def store(array, i, m):
    """Set `array[i]`.

    Args:
        array: Matrices (n, 3, 3).
        i: Index.
        m: Nine numbers, row by row.
    """
    for k in range(9):
        array[i, k // 3, k % 3] = m[k]


@scalar_or_simd
def transpose(m):
    """Transpose M^T.

    Args:
        m: Nine numbers, row by row.

    Returns:
        Nine numbers, row by row.
    """
    return (m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8])


@scalar_or_simd
def cofactor(m):
    """Matrix of cofactors: M^-T = cofactor / det.

    Args:
        m: Nine numbers, row by row.

    Returns:
        Nine numbers, row by row.
    """
    a, b, c, d, e, f, g, h, i = m
    return (e * i - f * h, f * g - d * i, d * h - e * g,
            c * h - b * i, a * i - c * g, b * g - a * h,
            b * f - c * e, c * d - a * f, a * e - b * d)  # fmt: skip


@scalar_or_simd
def product(m, n):
    """Matrix product M N.

    Args:
        m: Nine numbers, row by row.
        n: Nine numbers, row by row.

    Returns:
        Nine numbers, row by row.
    """
    a, b, c, d, e, f, g, h, i = m
    j, k, p, q, r, s, t, u, v = n
    return (a * j + b * q + c * t, a * k + b * r + c * u, a * p + b * s + c * v,
            d * j + e * q + f * t, d * k + e * r + f * u, d * p + e * s + f * v,
            g * j + h * q + i * t, g * k + h * r + i * u, g * p + h * s + i * v)  # fmt: skip


@scalar_or_simd
def rotation_vector(r):
    """Logarithm of a rotation, through its quaternion: angles near pi are as accurate as small ones.

    Args:
        r: Rotation: nine numbers, row by row. Scalars only.

    Returns:
        Rotation vector (3) in radians.
    """
    # Four times the squares of w, x, y, z: the largest divides.
    ww, xx = 1 + r[0] + r[4] + r[8], 1 + r[0] - r[4] - r[8]
    yy, zz = 1 - r[0] + r[4] - r[8], 1 - r[0] - r[4] + r[8]
    if ww >= max(xx, yy, zz):
        w, x, y, z = ww, r[7] - r[5], r[2] - r[6], r[3] - r[1]
    elif xx >= max(yy, zz):
        w, x, y, z = r[7] - r[5], xx, r[3] + r[1], r[2] + r[6]
    elif yy >= zz:
        w, x, y, z = r[2] - r[6], r[3] + r[1], yy, r[7] + r[5]
    else:
        w, x, y, z = r[3] - r[1], r[2] + r[6], r[7] + r[5], zz
    if w < 0:
        w, x, y, z = -w, -x, -y, -z
    square = x * x + y * y + z * z
    if square < _SMALL_SQUARE * w * w:
        factor = 2.0 / w * _series(square / (w * w), _ARCTANGENT)
    else:
        length = math.sqrt(square)
        factor = 2.0 * math.atan2(length, w) / length
    return factor * x, factor * y, factor * z


@scalar_or_simd
def apply(m, x):
    """Product M x.

    Args:
        m: Nine numbers, row by row.
        x: Three numbers.

    Returns:
        Three numbers.
    """
    return matrix_vector(m, x)


@scalar_or_simd
def apply_transposed(m, x):
    """Product M^T x.

    Args:
        m: Nine numbers, row by row.
        x: Three numbers.

    Returns:
        Three numbers.
    """
    return matrix_vector(transpose(m), x)


@scalar_or_simd
def apply_symmetric(p, x):
    """Product P x of a symmetric matrix.

    Args:
        p: Six numbers: xx, xy, xz, yy, yz, zz.
        x: Three numbers.

    Returns:
        Three numbers.
    """
    return matrix_vector((p[0], p[1], p[2], p[1], p[3], p[4], p[2], p[4], p[5]), x)


@scalar_or_simd
def cross(a, b):
    """Cross product.

    Args:
        a: Three numbers.
        b: Three numbers.

    Returns:
        Three numbers.
    """
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


@scalar_or_simd
def dot(a, b):
    """Scalar product.

    Args:
        a: Three numbers.
        b: Three numbers.

    Returns:
        A number.
    """
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


# 1/1! - q/3! + q^2/5! .., 1/2! - q/4! .., 1/3! - q/5! ..: the first term left out is below 1e-13 for angles up to pi.
_TERMS = 12
_A, _B, _C = (tuple((-1) ** k / math.factorial(2 * k + n) for k in range(_TERMS)) for n in (1, 2, 3))
# atan(t) / t in the square of t; below this square the first term left out is smaller than rounding.
_ARCTANGENT = tuple((-1) ** k / (2 * k + 1) for k in range(_TERMS))
_SMALL_SQUARE = 0.05


@scalar_or_simd
def _series(q, coefficients):
    total = q * coefficients[_TERMS - 1] + coefficients[_TERMS - 2]
    for k in range(_TERMS - 3, -1, -1):
        total = total * q + coefficients[k]
    return total


@scalar_or_simd
def rodrigues_coefficients(w):
    """Coefficients of Rodrigues' formula and of its derivative.

    Args:
        w: Rotation vector (3) in radians, of length t <= pi.

    Returns:
        sin(t)/t, (1 - cos t)/t^2, (t - sin t)/t^3.
    """
    q = dot(w, w)
    return _series(q, _A), _series(q, _B), _series(q, _C)


@scalar_or_simd
def product_exp(u, w, a, b):
    """Product U exp(w), by Rodrigues' formula.

    Args:
        u: Nine numbers, row by row.
        w: Rotation vector (3) in radians.
        a: First of `rodrigues_coefficients(w)`.
        b: Second of them.

    Returns:
        Nine numbers, row by row.
    """
    x, y, z = w
    e = (1 - b * (y * y + z * z), b * x * y - a * z, b * x * z + a * y,
         b * x * y + a * z, 1 - b * (x * x + z * z), b * y * z - a * x,
         b * x * z - a * y, b * y * z + a * x, 1 - b * (x * x + y * y))  # fmt: skip
    return product(u, e)
