"""The formulas of Jacobian blend skinning, forward and backward, for one surfel or sixteen.

All arguments are tuples of numbers: scalars, or vectors of `simd`.  `own`, `one`, `two`, `three` are the stretches of
the own face and its neighbours (xx, xy, xz, yy, yz, zz), `turn` the neighbours' rotation vectors one after the other,
v the blend weights, which sum to one; q is the blended rotation, p the blended stretch, k the canonical frame.
"""

from __future__ import annotations

from carigs.simd import matrix3
from carigs.simd.vector_math import absolute, exp, maximum, sqrt
from carigs.simd.vectors import scalar_or_simd

SMALLEST = 1e-30
"""In place of lengths that could be 0 in a denominator."""
FAINTEST = 60.0
"""Blend logits below minus this count as this: their sigmoids must not all be 0."""


@scalar_or_simd
def sigmoid(x):
    """1 / (1 + e^-x)."""
    return 1.0 / (1.0 + exp(-x))


@scalar_or_simd
def shares_of(logits):
    """Sigmoids of the blend logits, and the inverse of their sum, which is never 0."""
    w0, w1 = sigmoid(maximum(-FAINTEST, logits[0])), sigmoid(maximum(-FAINTEST, logits[1]))
    w2, w3 = sigmoid(maximum(-FAINTEST, logits[2])), sigmoid(maximum(-FAINTEST, logits[3]))
    return (w0, w1, w2, w3), 1.0 / (w0 + w1 + w2 + w3)


@scalar_or_simd
def disc_axes(quaternion):
    """First two columns of the rotation matrix, the unit quaternion and the inverse of its length."""
    w, x, y, z = quaternion
    # By the largest number first: squares would overflow, or vanish.
    most = maximum(maximum(absolute(w), absolute(x)), maximum(absolute(y), absolute(z)))
    h = 1.0 / maximum(most, SMALLEST)
    w, x, y, z = w * h, x * h, y * h, z * h
    unit = 1.0 / sqrt(maximum(w * w + x * x + y * y + z * z, 1.0))
    w, x, y, z, g = w * unit, x * unit, y * unit, z * unit, h * unit
    first = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    second = (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x))
    return first, second, (w, x, y, z), g


@scalar_or_simd
def _scaled(s, x):
    return s * x[0], s * x[1], s * x[2]


@scalar_or_simd
def blended_motion(v, own, one, two, three, turn):
    """Blended rotation vector (relative to the own face) and stretch."""
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
    return w, p


@scalar_or_simd
def carried(q, p, k, position, first, second, s, t):
    """Offset from the triangle's centre, and the tangents: J_b k R mu, J_b k R r S."""
    x = matrix3.apply(q, matrix3.apply_symmetric(p, matrix3.apply(k, position)))
    u = matrix3.apply(q, matrix3.apply_symmetric(p, matrix3.apply(k, _scaled(s, first))))
    v = matrix3.apply(q, matrix3.apply_symmetric(p, matrix3.apply(k, _scaled(t, second))))
    return x, u, v


@scalar_or_simd
def _quaternion_gradient(unit, length, du, dv):
    """From the gradients of the disc's axes; `length` is the inverse of the quaternion's."""
    qw, qx, qy, qz = unit
    dw = 2 * (qz * du[1] - qy * du[2] - qz * dv[0] + qx * dv[2])
    dx = 2 * (qy * du[1] + qz * du[2] + qy * dv[0] - 2 * qx * dv[1] + qw * dv[2])
    dy = 2 * (-2 * qy * du[0] + qx * du[1] - qw * du[2] + qx * dv[0] + qz * dv[2])
    dz = 2 * (-2 * qz * du[0] + qw * du[1] + qx * du[2] - qw * dv[0] - 2 * qz * dv[1] + qy * dv[2])
    along = dw * qw + dx * qx + dy * qy + dz * qz
    return (
        length * (dw - along * qw), length * (dx - along * qx),
        length * (dy - along * qy), length * (dz - along * qz),
    )  # fmt: skip


@scalar_or_simd
def view_direction(q, centre, eye, turning):
    """Unit vector from the eye, the inverse of its length, and the vector in the axes that q turns if `turning`."""
    x, y, z = centre[0] - eye[0], centre[1] - eye[1], centre[2] - eye[2]
    g = 1.0 / sqrt(maximum(x * x + y * y + z * z, 1e-24))
    n = (x * g, y * g, z * g)
    if turning:
        return n, g, matrix3.apply_transposed(q, n)
    return n, g, n


@scalar_or_simd
def direction_gradient(q, n, length, d, gd, turning):
    """From the gradient of a `view_direction` to the centre's, and its torque: d(Q^T n) = d x dw."""
    up = gd
    torque = _scaled(0.0, gd)
    if turning:
        up, torque = matrix3.apply(q, gd), matrix3.cross(gd, d)
    along = matrix3.dot(n, up)
    centre = (length * (up[0] - along * n[0]), length * (up[1] - along * n[1]), length * (up[2] - along * n[2]))
    return centre, torque


@scalar_or_simd
def torque_of(p, h, y):
    """Gradient with respect to dw in Q exp(dw), where d(Q P y) = Q (dw x P y), summed over the vectors y."""
    x = matrix3.cross(matrix3.apply_symmetric(p, y[0]), h[0])
    u = matrix3.cross(matrix3.apply_symmetric(p, y[1]), h[1])
    v = matrix3.cross(matrix3.apply_symmetric(p, y[2]), h[2])
    return x[0] + u[0] + v[0], x[1] + u[1] + v[1], x[2] + u[2] + v[2]


@scalar_or_simd
def turn_gradient(w, b, c, torque):
    """From a torque to the blended rotation vector: the right Jacobian's transpose I + b [w] + c [w]^2."""
    once = matrix3.cross(w, torque)
    twice = matrix3.cross(w, once)
    return (
        torque[0] + b * once[0] + c * twice[0],
        torque[1] + b * once[1] + c * twice[1],
        torque[2] + b * once[2] + c * twice[2],
    )


@scalar_or_simd
def stretch_gradient(h, y):
    """To the blended stretch, from the gradients h after it and the vectors y before it."""
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
def _six(a, b):
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3] + a[4] * b[4] + a[5] * b[5]


@scalar_or_simd
def blend_gradient(shares, g, dturn, dp, own, one, two, three, turn):
    """To the logits, through the normalised sigmoids."""
    d0 = _six(dp, own)
    d1 = _six(dp, one) + matrix3.dot(dturn, turn[0:3])
    d2 = _six(dp, two) + matrix3.dot(dturn, turn[3:6])
    d3 = _six(dp, three) + matrix3.dot(dturn, turn[6:9])
    w0, w1, w2, w3 = shares
    mean = g * (w0 * d0 + w1 * d1 + w2 * d2 + w3 * d3)
    return (
        g * w0 * (1 - w0) * (d0 - mean), g * w1 * (1 - w1) * (d1 - mean),
        g * w2 * (1 - w2) * (d2 - mean), g * w3 * (1 - w3) * (d3 - mean),
    )  # fmt: skip


@scalar_or_simd
def pulled_back(q, p, k, first, second, unit, length, s, t, g_centre, g_u, g_v, position):
    """Gradients of position, quaternion and logarithmic scales; and what the blend's gradients need."""
    hx, hu, hv = (
        matrix3.apply_transposed(q, g_centre),
        matrix3.apply_transposed(q, _scaled(s, g_u)),
        matrix3.apply_transposed(q, _scaled(t, g_v)),
    )
    d_position = matrix3.apply_transposed(k, matrix3.apply_symmetric(p, hx))
    du = matrix3.apply_transposed(k, matrix3.apply_symmetric(p, hu))
    dv = matrix3.apply_transposed(k, matrix3.apply_symmetric(p, hv))
    d_scale = (matrix3.dot(first, du), matrix3.dot(second, dv))
    x, u, v = matrix3.apply(k, position), matrix3.apply(k, first), matrix3.apply(k, second)
    return d_position, _quaternion_gradient(unit, length, du, dv), d_scale, (hx, hu, hv), (x, u, v)
