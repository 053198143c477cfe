"""The loops of `skinning` for float32, sixteen surfels at a time; the last sixteen overlap the ones before."""

from __future__ import annotations

import numpy as np

from carigs.simd import matrix3
from carigs.simd.kernels import kernel, parallel_for
from carigs.simd.memory import align_stack, gather_rows, load, load2, load3, load4, store, store2, store3, store4
from carigs.simd.vector_math import absolute, exp, select
from carigs.simd.vectors import WIDTH, broadcast, simd_inline, simd_inline_alloc
from carigs.splat.rig.face_motion import MOTION_ROW
from carigs.splat.rig.jacobian_blend import (
    blend_gradient,
    blended_motion,
    carried,
    direction_gradient,
    disc_axes,
    pulled_back,
    shares_of,
    sigmoid,
    stretch_gradient,
    torque_of,
    turn_gradient,
    view_direction,
)

PART = 1024  # surfels of one task


@simd_inline
def _faces(i, binding, frame_rows, neighbours, rows, around):
    """The same as `_face` for the faces of sixteen surfels, and their canonical frames."""
    for r in range(WIDTH):
        for side in range(3):
            around[side * WIDTH + r] = neighbours[3 * binding[i + r] + side]
    first = gather_rows(rows, binding, i, MOTION_ROW, 0)
    last = gather_rows(rows, binding, i, MOTION_ROW, WIDTH)
    frame = gather_rows(frame_rows, binding, i, WIDTH, 0)
    one = gather_rows(rows, around, 0, MOTION_ROW, 0)
    two = gather_rows(rows, around, WIDTH, MOTION_ROW, 0)
    three = gather_rows(rows, around, 2 * WIDTH, MOTION_ROW, 0)
    # Slices of tuples must be written in numbers: the columns STRETCH, CENTRE, ROTATION and TURN.
    rotation = first[9:16] + last[0:2]
    return first[0:6], one[0:6], two[0:6], three[0:6], last[2:11], rotation, first[6:9], frame[0:9]


@simd_inline
def _weights_of(blend, i, blended):
    if blended:
        return shares_of(load4(blend, 4 * i))
    one, none = broadcast(np.float32(1)), broadcast(np.float32(0))
    return (one, none, none, none), one


@simd_inline
def _size(v):
    return absolute(v[0]) + absolute(v[1]) + absolute(v[2])


@simd_inline
def _unless4(condition, v):
    none = broadcast(np.float32(0))
    return (
        select(condition, none, v[0]), select(condition, none, v[1]),
        select(condition, none, v[2]), select(condition, none, v[3]),
    )  # fmt: skip


@simd_inline
def _forward_sixteen(
    i, position, quaternion, log_scale, logit, blend, binding, frame_rows, neighbours, rows, blended,
    eye, turning, centre, tangent_u, tangent_v, opacity, direction, around,
):  # fmt: skip
    align_stack()
    own, one, two, three, turn, u, t, k = _faces(i, binding, frame_rows, neighbours, rows, around)
    shares, g = _weights_of(blend, i, blended)
    v = (g * shares[0], g * shares[1], g * shares[2], g * shares[3])
    w, p = blended_motion(v, own, one, two, three, turn)
    a, b, _c = matrix3.rodrigues_coefficients(w)
    q = matrix3.product_exp(u, w, a, b)
    first, second, _unit, _length = disc_axes(load4(quaternion, 4 * i))
    scale = load2(log_scale, 2 * i)
    x, tu, tv = carried(q, p, k, load3(position, 3 * i), first, second, exp(scale[0]), exp(scale[1]))
    x = (x[0] + t[0], x[1] + t[1], x[2] + t[2])
    store3(centre, 3 * i, x)
    store3(tangent_u, 3 * i, tu)
    store3(tangent_v, 3 * i, tv)
    store(opacity, i, sigmoid(load(logit, i)))
    if len(direction) > 0:
        _n, _g, d = view_direction(q, x, eye, turning)
        store3(direction, 3 * i, d)


@simd_inline
def _backward_sixteen(
    i, position, quaternion, log_scale, logit, blend, binding, frame_rows, neighbours, rows, blended,
    eye, turning, centre, g_centre, g_u, g_v, g_opacity, g_direction,
    d_position, d_quaternion, d_log_scale, d_logit, d_blend, around,
):  # fmt: skip
    align_stack()
    up_x, up_u, up_v = load3(g_centre, 3 * i), load3(g_u, 3 * i), load3(g_v, 3 * i)
    none = broadcast(np.float32(0))
    seen, up_d = len(g_direction) > 0, (none, none, none)
    if seen:
        up_d = load3(g_direction, 3 * i)
    change = _size(up_x) + _size(up_u) + _size(up_v) + _size(up_d) + absolute(load(g_opacity, i))
    still = change <= none
    own, one, two, three, turn, u, _t, k = _faces(i, binding, frame_rows, neighbours, rows, around)
    shares, g = _weights_of(blend, i, blended)
    v = (g * shares[0], g * shares[1], g * shares[2], g * shares[3])
    w, p = blended_motion(v, own, one, two, three, turn)
    a, b, c = matrix3.rodrigues_coefficients(w)
    q = matrix3.product_exp(u, w, a, b)
    first, second, unit, length = disc_axes(load4(quaternion, 4 * i))
    scale = load2(log_scale, 2 * i)
    torque = (none, none, none)
    if seen:
        n, near, d = view_direction(q, load3(centre, 3 * i), eye, turning)
        more, torque = direction_gradient(q, n, near, d, up_d, turning)
        up_x = (up_x[0] + more[0], up_x[1] + more[1], up_x[2] + more[2])
    dx, dq, ds, h, y = pulled_back(
        q, p, k, first, second, unit, length, exp(scale[0]), exp(scale[1]), up_x, up_u, up_v, load3(position, 3 * i)
    )
    store3(d_position, 3 * i, (select(still, none, dx[0]), select(still, none, dx[1]), select(still, none, dx[2])))
    store4(d_quaternion, 4 * i, _unless4(still, dq))
    store2(d_log_scale, 2 * i, (select(still, none, ds[0]), select(still, none, ds[1])))
    opacity = sigmoid(load(logit, i))
    store(d_logit, i, select(still, none, load(g_opacity, i) * opacity * (1 - opacity)))
    db = (none, none, none, none)
    if blended:
        own_torque = torque_of(p, h, y)
        torque = (torque[0] + own_torque[0], torque[1] + own_torque[1], torque[2] + own_torque[2])
        dturn, dp = turn_gradient(w, b, c, torque), stretch_gradient(h, y)
        db = blend_gradient(shares, g, dturn, dp, own, one, two, three, turn)
    store4(d_blend, 4 * i, _unless4(still, db))


@simd_inline_alloc
def _forward_part(
    part, count, position, quaternion, log_scale, logit, blend, binding, frame_rows, neighbours, rows, blended,
    eye, turning, centre, tangent_u, tangent_v, opacity, direction,
):  # fmt: skip
    around = np.empty(3 * WIDTH, np.int32)
    for start in range(part * PART, min((part + 1) * PART, count), WIDTH):
        _forward_sixteen(
            min(start, count - WIDTH), position, quaternion, log_scale, logit, blend, binding, frame_rows, neighbours,
            rows, blended, eye, turning, centre, tangent_u, tangent_v, opacity, direction, around,
        )  # fmt: skip


@simd_inline_alloc
def _backward_part(
    part, count, position, quaternion, log_scale, logit, blend, binding, frame_rows, neighbours, rows, blended,
    eye, turning, centre, g_centre, g_u, g_v, g_opacity, g_direction,
    d_position, d_quaternion, d_log_scale, d_logit, d_blend,
):  # fmt: skip
    around = np.empty(3 * WIDTH, np.int32)
    for start in range(part * PART, min((part + 1) * PART, count), WIDTH):
        _backward_sixteen(
            min(start, count - WIDTH), position, quaternion, log_scale, logit, blend, binding, frame_rows, neighbours,
            rows, blended, eye, turning, centre, g_centre, g_u, g_v, g_opacity, g_direction,
            d_position, d_quaternion, d_log_scale, d_logit, d_blend, around,
        )  # fmt: skip


@kernel
def skin(count, *arguments):
    """As `skinning.skin_each`, on flat arrays of `count` surfels."""
    parallel_for(_forward_part, (count + PART - 1) // PART, (count, *arguments))


@kernel
def skin_backward(count, *arguments):
    """As `skinning.skin_each_backward`, on flat arrays of `count` surfels."""
    parallel_for(_backward_part, (count + PART - 1) // PART, (count, *arguments))
