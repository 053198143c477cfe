"""Formulas of Jacobian blend skinning (paper equation 6), forward and backward, for one surfel or sixteen at a time.

A triangle moves by its Jacobian J = U P: rotation U, symmetric stretch P, both from the canonical to the posed mesh.  A
surfel blends the motions of its own triangle and of the three neighbours with weights v_0 .. v_3, which sum to one:

    J_b = Q P_b,    Q = U exp(sum_i v_i log(U^T U_i)),    P_b = sum_i v_i P_i                       (equation 6)
    centre = J_b K mu + T,    tangents = J_b K r S

with K = k_c R_c the canonical frame, mu the local position, r the disc's two axes, S its standard deviations and T the
centre of the posed triangle.  SurFhead (Lee et al. 2025) blends absolute rotation vectors log U_i, which jump where the
head turns by pi; those relative to the own triangle do not.

All arguments are tuples of numbers: scalars, or vectors of `carigs.simd`.  Names in the functions:

    faces              stretches (xx, xy, xz, yy, yz, zz) of the own triangle and its three neighbours, then the
                       neighbours' rotation vectors log(U^T U_i) one after the other (nine numbers)
    sigmoids, inverse_sum    sigmoids of the blend logits and one over their sum: v_i = inverse_sum * sigmoids[i]
    blend              result of `blend_motion`: v, the rotation vector w = sum v_i log(U^T U_i), P_b, the terms of the
                       exponential, Q
    axes               result of `disc_axes`
"""

from __future__ import annotations

from carigs.simd import matrix3
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


@scalar_or_simd
def add(a, b):
    """Sum of two vectors of three numbers.

    Args:
        a: Vector.
        b: Vector.

    Returns:
        a + b.
    """
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@scalar_or_simd
def scaled(s, x):
    """Product of a number and a vector of three numbers.

    Args:
        s: Factor.
        x: Vector.

    Returns:
        s x.
    """
    return s * x[0], s * x[1], s * x[2]


@scalar_or_simd
def blend_weights(logits):
    """Sigmoids of the blend logits and the inverse of their sum; the weights v_i are the normalised sigmoids.

    Args:
        logits: Four logits: own triangle, then its neighbours.

    Returns:
        Four sigmoids, and one over their sum, which is never 0.
    """
    w0, w1 = sigmoid(maximum(MIN_LOGIT, logits[0])), sigmoid(maximum(MIN_LOGIT, logits[1]))
    w2, w3 = sigmoid(maximum(MIN_LOGIT, logits[2])), sigmoid(maximum(MIN_LOGIT, logits[3]))
    return (w0, w1, w2, w3), 1.0 / (w0 + w1 + w2 + w3)


@scalar_or_simd
def blend_motion(sigmoids, inverse_sum, faces, rotation):
    """Blend the motions of a triangle and its neighbours (paper equation 6, see the head of this module).

    Args:
        sigmoids: Sigmoids of the four blend logits.
        inverse_sum: One over their sum.
        faces: Stretches and relative rotation vectors, see above.
        rotation: U of the own triangle.

    Returns:
        The weights v, the rotation vector w = sum v_i log(U^T U_i) in radians, P_b = sum v_i P_i, the terms of exp(w)
        (`matrix3.exponential_terms`), and Q = U exp(w).
    """
    own, one, two, three, turn = faces
    v = (inverse_sum * sigmoids[0], inverse_sum * sigmoids[1], inverse_sum * sigmoids[2], inverse_sum * sigmoids[3])
    w = (
        v[1] * turn[0] + v[2] * turn[3] + v[3] * turn[6],
        v[1] * turn[1] + v[2] * turn[4] + v[3] * turn[7],
        v[1] * turn[2] + v[2] * turn[5] + v[3] * turn[8],
    )
    p = (
        v[0] * own[0] + v[1] * one[0] + v[2] * two[0] + v[3] * three[0],
        v[0] * own[1] + v[1] * one[1] + v[2] * two[1] + v[3] * three[1],
        v[0] * own[2] + v[1] * one[2] + v[2] * two[2] + v[3] * three[2],
        v[0] * own[3] + v[1] * one[3] + v[2] * two[3] + v[3] * three[3],
        v[0] * own[4] + v[1] * one[4] + v[2] * two[4] + v[3] * three[4],
        v[0] * own[5] + v[1] * one[5] + v[2] * two[5] + v[3] * three[5],
    )
    terms = matrix3.exponential_terms(w)
    return v, w, p, terms, matrix3.turned(rotation, w, terms[0], terms[1])


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
    w, x, y, z = w * h, x * h, y * h, z * h
    unit = 1.0 / sqrt(maximum(w * w + x * x + y * y + z * z, 1.0))
    w, x, y, z, g = w * unit, x * unit, y * unit, z * unit, h * unit
    first = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    second = (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x))
    return first, second, (w, x, y, z), g


@scalar_or_simd
def skin_surfel(blend, frame, centre, position, axes, scale):
    """Carry one surfel to the posed mesh: J_b K mu + T and J_b K r S (paper equation 6).

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
    _v, _w, p, _terms, q = blend
    x = matrix3.apply(q, matrix3.apply_symmetric(p, matrix3.apply(frame, position)))
    u = matrix3.apply(q, matrix3.apply_symmetric(p, matrix3.apply(frame, scaled(scale[0], axes[0]))))
    v = matrix3.apply(q, matrix3.apply_symmetric(p, matrix3.apply(frame, scaled(scale[1], axes[1]))))
    return add(x, centre), u, v


@scalar_or_simd
def skin_surfel_gradient(blend, frame, position, axes, scale, gradients):
    """Backward pass of `skin_surfel`, for the surfel's own attributes.

    Args:
        blend: As in `skin_surfel`.
        frame: As in `skin_surfel`.
        position: As in `skin_surfel`.
        axes: As in `skin_surfel`.
        scale: As in `skin_surfel`.
        gradients: Gradients with respect to the centre and the two tangents.

    Returns:
        Gradients with respect to position, quaternion and logarithmic scales; and, for `motion_gradient`, the gradients
        h with respect to the three vectors P_b y, and the three vectors y = K mu, K r (the factors S are in h).
    """
    _v, _w, p, _terms, q = blend
    first, second, unit, inverse_length = axes
    hx, hu, hv = (
        matrix3.apply_transposed(q, gradients[0]),
        matrix3.apply_transposed(q, scaled(scale[0], gradients[1])),
        matrix3.apply_transposed(q, scaled(scale[1], gradients[2])),
    )
    d_position = matrix3.apply_transposed(frame, matrix3.apply_symmetric(p, hx))
    du = matrix3.apply_transposed(frame, matrix3.apply_symmetric(p, hu))
    dv = matrix3.apply_transposed(frame, matrix3.apply_symmetric(p, hv))
    d_scale = (matrix3.dot(first, du), matrix3.dot(second, dv))
    y = matrix3.apply(frame, position), matrix3.apply(frame, first), matrix3.apply(frame, second)
    return d_position, _quaternion_gradient(unit, inverse_length, du, dv), d_scale, (hx, hu, hv), y


@scalar_or_simd
def _quaternion_gradient(unit, inverse_length, du, dv):
    qw, qx, qy, qz = unit
    dw = 2 * (qz * du[1] - qy * du[2] - qz * dv[0] + qx * dv[2])
    dx = 2 * (qy * du[1] + qz * du[2] + qy * dv[0] - 2 * qx * dv[1] + qw * dv[2])
    dy = 2 * (-2 * qy * du[0] + qx * du[1] - qw * du[2] + qx * dv[0] + qz * dv[2])
    dz = 2 * (-2 * qz * du[0] + qw * du[1] + qx * du[2] - qw * dv[0] - 2 * qz * dv[1] + qy * dv[2])
    along = dw * qw + dx * qx + dy * qy + dz * qz
    return (
        inverse_length * (dw - along * qw), inverse_length * (dx - along * qx),
        inverse_length * (dy - along * qy), inverse_length * (dz - along * qz),
    )  # fmt: skip


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
    x, y, z = centre[0] - eye[0], centre[1] - eye[1], centre[2] - eye[2]
    g = 1.0 / sqrt(maximum(x * x + y * y + z * z, 1e-24))
    n = (x * g, y * g, z * g)
    if rotate:
        return n, g, matrix3.apply_transposed(rotation, n)
    return n, g, n


@scalar_or_simd
def view_direction_gradient(rotation, centre, eye, rotate, g_direction, g_centre):
    """Backward pass of `view_direction`: d(Q^T n) = Q^T n x dw for Q exp(dw).

    Args:
        rotation: As in `view_direction`.
        centre: As in `view_direction`.
        eye: As in `view_direction`.
        rotate: As in `view_direction`.
        g_direction: Gradient with respect to the direction.
        g_centre: Gradient with respect to the centre by other ways.

    Returns:
        The whole gradient with respect to the centre, the gradient with respect to dw, and the unit vector n.
    """
    n, g, d = view_direction(rotation, centre, eye, rotate)
    up = g_direction
    torque = scaled(0.0, g_direction)
    if rotate:
        up, torque = matrix3.apply(rotation, g_direction), matrix3.cross(g_direction, d)
    along = matrix3.dot(n, up)
    through = (g * (up[0] - along * n[0]), g * (up[1] - along * n[1]), g * (up[2] - along * n[2]))
    return add(g_centre, through), torque, n


@scalar_or_simd
def motion_gradient(blend, h, y, torque):
    """Backward pass to the blended motion.

    With Q exp(dw), d(Q P y) = Q (dw x P y); from dw to w by the transpose of the right Jacobian of SO(3),
    I + b [w] + c [w]^2 (Sola et al. 2018, equation 143).

    Args:
        blend: Result of `blend_motion`.
        h: Gradients with respect to the three vectors P_b y, from `skin_surfel_gradient`.
        y: The three vectors.
        torque: Gradient with respect to dw by other ways (`view_direction_gradient`).

    Returns:
        Gradients with respect to the rotation vector w and to the six numbers of P_b.
    """
    _v, w, p, (_a, b, c), _q = blend
    first = matrix3.cross(matrix3.apply_symmetric(p, y[0]), h[0])
    second = matrix3.cross(matrix3.apply_symmetric(p, y[1]), h[1])
    third = matrix3.cross(matrix3.apply_symmetric(p, y[2]), h[2])
    torque = add(torque, add(add(first, second), third))
    once = matrix3.cross(w, torque)
    twice = matrix3.cross(w, once)
    d_w = (
        torque[0] + b * once[0] + c * twice[0],
        torque[1] + b * once[1] + c * twice[1],
        torque[2] + b * once[2] + c * twice[2],
    )
    return d_w, _stretch_gradient(h, y)


@scalar_or_simd
def _stretch_gradient(h, y):
    (hx, hu, hv), (x, u, v) = h, y
    return (
        hx[0] * x[0] + hu[0] * u[0] + hv[0] * v[0],
        hx[0] * x[1] + hx[1] * x[0] + hu[0] * u[1] + hu[1] * u[0] + hv[0] * v[1] + hv[1] * v[0],
        hx[0] * x[2] + hx[2] * x[0] + hu[0] * u[2] + hu[2] * u[0] + hv[0] * v[2] + hv[2] * v[0],
        hx[1] * x[1] + hu[1] * u[1] + hv[1] * v[1],
        hx[1] * x[2] + hx[2] * x[1] + hu[1] * u[2] + hu[2] * u[1] + hv[1] * v[2] + hv[2] * v[1],
        hx[2] * x[2] + hu[2] * u[2] + hv[2] * v[2],
    )


@scalar_or_simd
def _dot6(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5]


@scalar_or_simd
def blend_gradient(sigmoids, inverse_sum, d_w, d_p, faces):
    """Backward pass of `blend_weights` and the sums of equation 6.

    Args:
        sigmoids: Sigmoids of the four blend logits.
        inverse_sum: One over their sum.
        d_w: Gradient with respect to the blended rotation vector.
        d_p: Gradient with respect to the blended stretch.
        faces: Stretches and relative rotation vectors, see above.

    Returns:
        Gradients with respect to the four logits.
    """
    own, one, two, three, turn = faces
    d0 = _dot6(d_p, own)
    d1 = _dot6(d_p, one) + matrix3.dot(d_w, turn[0:3])
    d2 = _dot6(d_p, two) + matrix3.dot(d_w, turn[3:6])
    d3 = _dot6(d_p, three) + matrix3.dot(d_w, turn[6:9])
    w0, w1, w2, w3 = sigmoids
    g = inverse_sum
    mean = g * (w0 * d0 + w1 * d1 + w2 * d2 + w3 * d3)
    return (
        g * w0 * (1 - w0) * (d0 - mean), g * w1 * (1 - w1) * (d1 - mean),
        g * w2 * (1 - w2) * (d2 - mean), g * w3 * (1 - w3) * (d3 - mean),
    )  # fmt: skip
