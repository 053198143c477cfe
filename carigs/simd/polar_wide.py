"""Rotations of polar decompositions, eight matrices at a time in double precision: five times as fast as one by one."""

from __future__ import annotations

from carigs.simd import matrix3
from carigs.simd.memory import load_wide, store_wide
from carigs.simd.tuples import add, multiply, subtract
from carigs.simd.vector_math import absolute, maximum, select, sqrt
from carigs.simd.vectors import WIDE, any_wide, scalar_or_simd

BLOCK = 9 * WIDE
"""Numbers of a block: entry k of matrix r at place k * WIDE + r."""


@scalar_or_simd
def store_matrix(block, r, m):
    """Put a matrix into a block.

    Args:
        block: Flat array of `BLOCK` numbers.
        r: Place of the matrix, below `WIDE`.
        m: Nine numbers, row by row.
    """
    for k in range(9):
        block[k * WIDE + r] = m[k]


@scalar_or_simd
def load_matrix(block, r):
    """Take a matrix out of a block.

    Args:
        block: Flat array of `BLOCK` numbers.
        r: Place of the matrix.

    Returns:
        Nine numbers, row by row.
    """
    return (block[r], block[WIDE + r], block[2 * WIDE + r], block[3 * WIDE + r], block[4 * WIDE + r],
            block[5 * WIDE + r], block[6 * WIDE + r], block[7 * WIDE + r], block[8 * WIDE + r])  # fmt: skip


@scalar_or_simd
def _norm2(m):
    return matrix3.dot(m[0:3], m[0:3]) + matrix3.dot(m[3:6], m[3:6]) + matrix3.dot(m[6:9], m[6:9])


@scalar_or_simd
def polar_rotations(block):
    """Replace the matrices of a block by the rotations of their polar decompositions, by Newton's iteration.

    The iteration is scaled by Frobenius norms (Higham 1986).

    A matrix whose iteration has converged does not change any more: the result does not depend on its neighbours.

    Args:
        block: Flat array of `BLOCK` numbers: matrices with positive determinants.
    """
    u = (load_wide(block, 0), load_wide(block, WIDE), load_wide(block, 2 * WIDE), load_wide(block, 3 * WIDE),
         load_wide(block, 4 * WIDE), load_wide(block, 5 * WIDE), load_wide(block, 6 * WIDE), load_wide(block, 7 * WIDE),
         load_wide(block, 8 * WIDE))  # fmt: skip
    change = absolute(u[0]) * 0.0 + 1.0
    for _ in range(30):
        c = matrix3.cofactor(u)
        det = matrix3.dot(u[0:3], c[0:3])
        scale = sqrt(sqrt(_norm2(c) / _norm2(u)) / det)
        new = add(multiply(0.5 * scale, u), multiply(0.5 / (scale * det), c))
        moved = _largest(subtract(new, u))
        going = change >= 1e-8  # convergence is quadratic: the next step would change 1e-16
        u = _choose(going, new, u)
        change = select(going, moved, change)
        if not any_wide(change >= 1e-8):
            break
    for k in range(9):
        store_wide(block, k * WIDE, u[k])


@scalar_or_simd
def _largest(m):
    a = maximum(maximum(absolute(m[0]), absolute(m[1])), absolute(m[2]))
    b = maximum(maximum(absolute(m[3]), absolute(m[4])), absolute(m[5]))
    return maximum(maximum(a, b), maximum(maximum(absolute(m[6]), absolute(m[7])), absolute(m[8])))


@scalar_or_simd
def _choose(mask, a, b):
    return (select(mask, a[0], b[0]), select(mask, a[1], b[1]), select(mask, a[2], b[2]), select(mask, a[3], b[3]),
            select(mask, a[4], b[4]), select(mask, a[5], b[5]), select(mask, a[6], b[6]), select(mask, a[7], b[7]),
            select(mask, a[8], b[8]))  # fmt: skip
