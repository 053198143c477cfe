"""Formulas of Jacobian blend skinning (paper equation 6), for one surfel or sixteen at a time.

A triangle moves by its Jacobian J = U P: rotation U, symmetric stretch P, both from the canonical to the posed mesh. A
surfel blends the motions of its own triangle and of the three neighbours with weights v_i that sum to one. The paper's
equation 6 (SurFhead, Lee et al. 2025):

    Sigma^(1/2) = J_b r s,    mu' = J_b mu + T,    J_b = exp(sum_i v_i log(U_i)) sum_i v_i P_i

Here rotations are blended relative to that of the own triangle, U: the absolute rotation vectors log(U_i) jump where
the head turns by pi. With the canonical frame K = k_c R_c of the triangle (`Rig.frame`), in whose units mu and s are:

    J_b = Q P_b,    Q = U exp(sum_i v_i log(U^T U_i)),    P_b = sum_i v_i P_i
    centre = J_b K mu + T,    tangents = J_b K r s

mu is the local position, r the two axes of the disc, s its standard deviations, T the centre of the posed triangle.
Surfels of triangles that keep the size of what grows on them (`Rig.keeps_size`) do not stretch: their tangents are
Q K r s, while their centres move as those of the others. With k = 1 there, and 0 elsewhere,

    tangents = Q P_t K r s,    P_t = k I + (1 - k) P_b

All arguments are tuples of numbers: scalars, or vectors of `carigs.simd`. The backward passes are in
`jacobian_blend_backward`. Names in the functions:

    faces              stretches (xx, xy, xz, yy, yz, zz) of the own triangle and its three neighbours, then the
                       neighbours' rotation vectors log(U^T U_i) one after the other (nine numbers)
    sigmoids, inverse_sum    sigmoids of the blend logits and one over their sum: v_i = inverse_sum * sigmoids[i]
    blend              result of `blend_motion`: v, the rotation vector w = sum v_i log(U^T U_i), P_b, the terms of the
                       exponential, Q, and of the tangents P_t and 1 - k
    axes               result of `disc_axes`
"""

from __future__ import annotations

from carigs.simd import matrix3
from carigs.simd.tuples import add, componentwise, multiply, subtract
from carigs.simd.vector_math import absolute, exp, maximum, sqrt
from carigs.simd.vectors import scalar_or_simd

MIN_LENGTH = 1e-30
"""Lower limit of a length in a denominator."""
MIN_LOGIT = -60.0
"""Lower limit of blend logits: their sigmoids must not all be 0."""


@scalar_or_simd
def sigmoid(x):
    """Logistic function 1 / (1 + e^-x).

    Args:
        x: A number.

    Returns:
        A number in [0, 1].
    """
    return 1.0 / (1.0 + exp(-x))


_sigmoids, _maximum = componentwise(sigmoid), componentwise(maximum)


@scalar_or_simd
def blend_weights(logits):
    """Sigmoids of the blend logits and the inverse of their sum; the weights v_i are the normalised sigmoids.

    Args:
        logits: Four logits: own triangle, then its neighbours.

    Returns:
        Four sigmoids, and one over their sum, which is never 0.
    """
    w = _sigmoids(_maximum(MIN_LOGIT, logits))
    return w, 1.0 / (w[0] + w[1] + w[2] + w[3])


@scalar_or_simd
def blend_motion(sigmoids, inverse_sum, faces, rotation, kept):
    """Blend the motions of a triangle and its neighbours (paper equation 6, see the head of this module).

    Args:
        sigmoids: Sigmoids of the four blend logits.
        inverse_sum: One over their sum.
        faces: Stretches and relative rotation vectors, see above.
        rotation: U of the own triangle.
        kept: k of the own triangle.

    Returns:
        The weights v, the rotation vector w = sum v_i log(U^T U_i) in radians, P_b = sum v_i P_i, the terms of exp(w)
        (`matrix3.rodrigues_coefficients`), Q = U exp(w), and the pair of P_t and 1 - k.
    """
    own, one, two, three, turn = faces
    v = multiply(inverse_sum, sigmoids)
    w = matrix3.apply_transposed(turn, v[1:4])
    p = add(add(add(multiply(v[0], own), multiply(v[1], one)), multiply(v[2], two)), multiply(v[3], three))
    terms = matrix3.rodrigues_coefficients(w)
    follows = 1.0 - kept
    xx, xy, xz, yy, yz, zz = multiply(follows, p)
    tangent = (xx + kept, xy, xz, yy + kept, yz, zz + kept)
    return v, w, p, terms, matrix3.product_exp(rotation, w, terms[0], terms[1]), (tangent, follows)


@scalar_or_simd
def disc_axes(quaternion):
    """Axes of a disc from its quaternion.

    Args:
        quaternion: wxyz, of any length.

    Returns:
        The first two columns of the rotation matrix, the unit quaternion, and one over the quaternion's length.
    """
    w, x, y, z = quaternion
    # Divided by the largest number first: squares could overflow, or vanish.
    largest = maximum(maximum(absolute(w), absolute(x)), maximum(absolute(y), absolute(z)))
    h = 1.0 / maximum(largest, MIN_LENGTH)
    w, x, y, z = multiply(quaternion, h)
    unit = 1.0 / sqrt(maximum(w * w + x * x + y * y + z * z, 1.0))
    w, x, y, z, g = multiply((w, x, y, z, h), unit)
    first = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    second = (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x))
    return first, second, (w, x, y, z), g


@scalar_or_simd
def skin_surfel(blend, frame, centre, position, axes, scale):
    """Carry one surfel to the posed mesh: J_b K mu + T and Q P_t K r s (paper equation 6).

    Args:
        blend: Result of `blend_motion`.
        frame: Canonical frame K of the own triangle.
        centre: Centre T of the own posed triangle in metres.
        position: Local position mu.
        axes: Result of `disc_axes`.
        scale: The two standard deviations in units of the triangle.

    Returns:
        Centre and the two tangents in world coordinates (metres).
    """
    _v, _w, p, _terms, q, (tangent, _follows) = blend
    x = matrix3.apply(q, matrix3.apply_symmetric(p, matrix3.apply(frame, position)))
    u = matrix3.apply(q, matrix3.apply_symmetric(tangent, matrix3.apply(frame, multiply(scale[0], axes[0]))))
    v = matrix3.apply(q, matrix3.apply_symmetric(tangent, matrix3.apply(frame, multiply(scale[1], axes[1]))))
    return add(x, centre), u, v


@scalar_or_simd
def view_direction(rotation, centre, eye, rotate):
    """Direction from the camera to a surfel.

    Args:
        rotation: Blended rotation Q.
        centre: World position of the surfel.
        eye: Camera centre in world coordinates.
        rotate: Whether the direction is wanted in the axes of the canonical head, Q^T n.

    Returns:
        The unit vector n in world axes, one over the distance, and Q^T n if `rotate`, else n.
    """
    x = subtract(centre, eye)
    g = 1.0 / sqrt(maximum(matrix3.dot(x, x), 1e-24))
    n = multiply(x, g)
    if rotate:
        return n, g, matrix3.apply_transposed(rotation, n)
    return n, g, n
