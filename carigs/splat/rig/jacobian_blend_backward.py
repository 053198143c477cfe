"""Backward passes of the formulas in `jacobian_blend`, with the same names of arguments."""

from __future__ import annotations

from carigs.simd import matrix3
from carigs.simd.tuples import add, componentwise, matrix_vector, multiply, subtract
from carigs.simd.vectors import scalar_or_simd
from carigs.splat.rig.jacobian_blend import view_direction


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
        Gradients with respect to position, quaternion and logarithmic scales; and two triples of vectors for
        `motion_gradient`. `skin_surfel` computes Q P_b y for y = K mu, and Q P_t y for y = K r_1 and K r_2, these two
        times a standard deviation. The first triple, h, holds the gradients with respect to P y, with these factors;
        the second one holds y, without them.
    """
    _v, _w, p, _terms, q, (tangent, _follows) = blend
    first, second, unit, inverse_length = axes
    hx, hu, hv = (
        matrix3.apply_transposed(q, gradients[0]),
        matrix3.apply_transposed(q, multiply(scale[0], gradients[1])),
        matrix3.apply_transposed(q, multiply(scale[1], gradients[2])),
    )
    d_position = matrix3.apply_transposed(frame, matrix3.apply_symmetric(p, hx))
    du = matrix3.apply_transposed(frame, matrix3.apply_symmetric(tangent, hu))
    dv = matrix3.apply_transposed(frame, matrix3.apply_symmetric(tangent, hv))
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
    return multiply(inverse_length, subtract((dw, dx, dy, dz), multiply(along, unit)))


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
    torque = multiply(0.0, g_direction)
    if rotate:
        up, torque = matrix3.apply(rotation, g_direction), matrix3.cross(g_direction, d)
    along = matrix3.dot(n, up)
    through = multiply(g, subtract(up, multiply(along, n)))
    return add(g_centre, through), torque, n


@scalar_or_simd
def motion_gradient(blend, h, y, torque):
    """Backward pass to the blended motion.

    With Q exp(dw), d(Q P y) = Q (dw x P y); from dw to w by the transpose of the right Jacobian of SO(3),
    I + b [w] + c [w]^2 (Sola et al. 2018, equation 143).

    Args:
        blend: Result of `blend_motion`.
        h: Gradients with respect to the three vectors P y: fourth result of `skin_surfel_gradient`.
        y: The three vectors K mu, K r_1 and K r_2 in the axes of the canonical mesh: its fifth result.
        torque: Gradient with respect to dw by other ways (`view_direction_gradient`).

    Returns:
        Gradients with respect to the rotation vector w and to the six numbers of P_b.
    """
    _v, w, p, (_a, b, c), _q, (tangent, follows) = blend
    first = matrix3.cross(matrix3.apply_symmetric(p, y[0]), h[0])
    second = matrix3.cross(matrix3.apply_symmetric(tangent, y[1]), h[1])
    third = matrix3.cross(matrix3.apply_symmetric(tangent, y[2]), h[2])
    torque = add(torque, add(add(first, second), third))
    once = matrix3.cross(w, torque)
    twice = matrix3.cross(w, once)
    return add(add(torque, multiply(b, once)), multiply(c, twice)), _stretch_gradient(h, y, follows)


@scalar_or_simd
def rotation_gradient(blend, h, y):
    """Backward pass to the rows of the own triangle's rotation U, by the uses of Q = U exp(w) in skinning.

    Args:
        blend: Result of `blend_motion`.
        h: Fourth result of `skin_surfel_gradient`.
        y: Fifth result of `skin_surfel_gradient`.

    Returns:
        Three rows of three numbers.
    """
    _v, w, p, (a, b, _c), q, (tangent, _follows) = blend
    py = (
        matrix3.apply_symmetric(p, y[0]), matrix3.apply_symmetric(tangent, y[1]), matrix3.apply_symmetric(tangent, y[2])
    )  # fmt: skip
    g = (matrix3.apply(q, h[0]), matrix3.apply(q, h[1]), matrix3.apply(q, h[2]))
    return (
        turned_row(w, a, b, add(add(multiply(g[0][0], py[0]), multiply(g[1][0], py[1])), multiply(g[2][0], py[2]))),
        turned_row(w, a, b, add(add(multiply(g[0][1], py[0]), multiply(g[1][1], py[1])), multiply(g[2][1], py[2]))),
        turned_row(w, a, b, add(add(multiply(g[0][2], py[0]), multiply(g[1][2], py[1])), multiply(g[2][2], py[2]))),
    )


@scalar_or_simd
def turned_row(w, a, b, row):
    """Row of a gradient with respect to U from that with respect to Q = U exp(w): exp(w) times the row.

    Args:
        w: Rotation vector.
        a: First of `matrix3.rodrigues_coefficients(w)`.
        b: Second of them.
        row: Three numbers.

    Returns:
        Three numbers.
    """
    once = matrix3.cross(w, row)
    return add(row, add(multiply(a, once), multiply(b, matrix3.cross(w, once))))


@scalar_or_simd
def _stretch_gradient(h, y, follows):
    hx, hu, hv, (x, u, v) = h[0], multiply(follows, h[1]), multiply(follows, h[2]), y
    return (
        hx[0] * x[0] + hu[0] * u[0] + hv[0] * v[0],
        hx[0] * x[1] + hx[1] * x[0] + hu[0] * u[1] + hu[1] * u[0] + hv[0] * v[1] + hv[1] * v[0],
        hx[0] * x[2] + hx[2] * x[0] + hu[0] * u[2] + hu[2] * u[0] + hv[0] * v[2] + hv[2] * v[0],
        hx[1] * x[1] + hu[1] * u[1] + hv[1] * v[1],
        hx[1] * x[2] + hx[2] * x[1] + hu[1] * u[2] + hu[2] * u[1] + hv[1] * v[2] + hv[2] * v[1],
        hx[2] * x[2] + hu[2] * u[2] + hv[2] * v[2],
    )


@scalar_or_simd
def _logit_gradient(w, g, d, mean):
    return g * w * (1 - w) * (d - mean)


_logit_gradients = componentwise(_logit_gradient)


@scalar_or_simd
def blend_gradient(sigmoids, inverse_sum, d_w, d_p, faces):
    """Backward pass of `blend_weights` and the sums of equation 6.

    Args:
        sigmoids: Sigmoids of the four blend logits.
        inverse_sum: One over their sum.
        d_w: Gradient with respect to the blended rotation vector.
        d_p: Gradient with respect to the blended stretch.
        faces: Stretches and relative rotation vectors, see `jacobian_blend`.

    Returns:
        Gradients with respect to the four logits.
    """
    own, one, two, three, turn = faces
    # With respect to each face's weight: through its stretch, and of neighbours through the relative rotation.
    d0, d1, d2, d3 = matrix_vector((*own, *one, *two, *three), d_p)
    d1, d2, d3 = add((d1, d2, d3), matrix3.apply(turn, d_w))
    w0, w1, w2, w3 = sigmoids
    mean = inverse_sum * (w0 * d0 + w1 * d1 + w2 * d2 + w3 * d3)
    return _logit_gradients(sigmoids, inverse_sum, (d0, d1, d2, d3), mean)
