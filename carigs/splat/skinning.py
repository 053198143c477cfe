"""Local -> world: surfels carried by their triangles through Jacobian blend skinning, with exact gradients.

World centre  J_b (k_c R_c mu) + T,  tangents  J_b k_c R_c r S,  where  J_b = U exp(sum v_i log(U^T U_i)) sum v_i P_i
blends the motions of the own face and its three neighbours.  SurFhead blends absolute rotation vectors, which wraps
where the head turns by pi; relative to the own face it does not.

The formulas are in `jacobian_blend`; here are the loops: sixteen surfels at a time for float32, one by one for float64,
which is how the tests check them.  What no pixel depends on has no gradient, whatever its numbers are (0 * NaN).  In
plain torch this would cost more than the rasteriser, and its exp would round differently with the number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from carigs.splat import matrix3
from carigs.splat.jacobian_blend import (
    blend_gradient,
    blended_motion,
    carried,
    disc_axes,
    pulled_back,
    shares_of,
    sigmoid,
    stretch_gradient,
    turn_gradient,
)
from carigs.splat.rig import CENTRE, MOTION_ROW, ROTATION, STRETCH, TURN, FaceMotion, Rig
from carigs.splat.simd import WIDTH, inner, splat
from carigs.splat.simd_math import absolute, exp, select
from carigs.splat.simd_memory import (
    align_stack,
    gather_rows,
    load,
    load2,
    load3,
    load4,
    store,
    store2,
    store3,
    store4,
    store9,
)
from carigs.splat.surfels import SH_BASE, Surfels


class Skinned(NamedTuple):
    """Surfels in the world, differentiable except for `rotation`."""

    centre: Float[Tensor, "n 3"]
    tangent_u: Float[Tensor, "n 3"]
    """World vectors as long as the standard deviations (metres)."""
    tangent_v: Float[Tensor, "n 3"]
    opacity: Float[Tensor, "n"]
    colour: Float[Tensor, "n 3"]
    """RGB of degree 0, not clamped."""
    rotation: Float[Tensor, "n 3 3"] | None
    """Blended rotation, posed from canonical; only where it was asked for."""


def skin(surfels: Surfels, rig: Rig, motion: FaceMotion, *, blend: bool = True, rotations: bool = False) -> Skinned:
    """Carry the surfels to the posed mesh; without `blend` by their own face's Jacobian alone."""
    mesh = (rig.frame_rows, rig.neighbours, motion.rows)
    outputs = _Skin.apply(
        surfels.position,
        surfels.rotation,
        surfels.log_scale,
        surfels.opacity,
        surfels.colour,
        surfels.blend,
        surfels.binding,
        mesh,
        blend,
        rotations,
    )
    return Skinned(*outputs)


PART = 1024  # surfels of one task


class _Skin(torch.autograd.Function):
    @staticmethod
    def forward(ctx, position, rotation, log_scale, opacity, colour, blend, binding, mesh, blended, rotations):
        n, dtype = len(binding), position.detach().numpy().dtype
        leaves = [t.detach().contiguous().numpy() for t in (position, rotation, log_scale, opacity, colour, blend)]
        shapes = ((n, 3), (n, 3), (n, 3), n, (n, 3), (n if rotations else 0, 3, 3))
        out = [np.empty(shape, dtype) for shape in shapes]
        ctx.vectors = dtype == np.float32 and n >= WIDTH
        if ctx.vectors:
            _forward_vectors(*_flat(leaves), binding, *_flat(mesh), blended, *_flat(out[:5]), out[5].reshape(-1))
        else:
            _forward(*leaves, binding, *mesh, blended, *out[:5], out[5].reshape(-1, 9))
        ctx.kept = leaves, binding, mesh, blended
        ctx.set_materialize_grads(True)
        outputs = tuple(torch.from_numpy(array) for array in out)
        if not rotations:
            return *outputs[:5], None
        ctx.mark_non_differentiable(outputs[5])
        return outputs

    @staticmethod
    def backward(ctx, centre, tangent_u, tangent_v, opacity, colour, _rotation):
        given = [g.contiguous().numpy() for g in (centre, tangent_u, tangent_v, opacity, colour)]
        leaves, binding, mesh, blended = ctx.kept
        gradients = [np.empty_like(leaf) for leaf in leaves]
        if ctx.vectors:
            _backward_vectors(*_flat(leaves), binding, *_flat(mesh), blended, *_flat(given), *_flat(gradients))
        else:
            _backward(*leaves, binding, *mesh, blended, *given, *gradients)
        return *(torch.from_numpy(g) for g in gradients), None, None, None, None


def _flat(arrays):
    return (array.reshape(-1) for array in arrays)


# One surfel at a time.


@numba.njit(cache=True)
def _face(f, neighbours, rows):
    """Stretches of the face and its neighbours, the neighbours' turns, rotation and centre of the face."""
    i, j, k = neighbours[f, 0], neighbours[f, 1], neighbours[f, 2]
    return (
        _numbers6(rows, f), _numbers6(rows, i), _numbers6(rows, j), _numbers6(rows, k), _numbers9(rows, f, TURN),
        _numbers9(rows, f, ROTATION), (rows[f, CENTRE], rows[f, CENTRE + 1], rows[f, CENTRE + 2]),
    )  # fmt: skip


@numba.njit(cache=True)
def _numbers4(rows, i):
    return rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3]


@numba.njit(cache=True)
def _numbers6(rows, f):
    r = rows[f, STRETCH : STRETCH + 6]
    return r[0], r[1], r[2], r[3], r[4], r[5]


@numba.njit(cache=True)
def _numbers9(rows, f, at):
    r = rows[f, at : at + 9]
    return r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8]


@numba.njit(cache=True, error_model="numpy")
def _forward(
    position, quaternion, log_scale, logit, dc, blend, binding, frame_rows, neighbours, rows, blended,
    centre, tangent_u, tangent_v, opacity, colour, turned,
):  # fmt: skip
    for i in range(len(binding)):
        own, one, two, three, turn, u, t = _face(binding[i], neighbours, rows)
        v = (1.0, 0.0, 0.0, 0.0)
        if blended:
            shares, g = shares_of(_numbers4(blend, i))
            v = (g * shares[0], g * shares[1], g * shares[2], g * shares[3])
        w, p = blended_motion(v, own, one, two, three, turn)
        a, b, _c = matrix3.exponential_terms(w)
        q = matrix3.turned(u, w, a, b)
        first, second, _unit, _length = disc_axes(
            (quaternion[i, 0], quaternion[i, 1], quaternion[i, 2], quaternion[i, 3])
        )
        x, tu, tv = carried(
            q, p, _numbers9(frame_rows, binding[i], 0), (position[i, 0], position[i, 1], position[i, 2]), first, second,
            exp(log_scale[i, 0]), exp(log_scale[i, 1]),
        )  # fmt: skip
        for c in range(3):
            centre[i, c], tangent_u[i, c], tangent_v[i, c] = x[c] + t[c], tu[c], tv[c]
            colour[i, c] = 0.5 + SH_BASE * dc[i, c]
        opacity[i] = sigmoid(logit[i])
        if len(turned) > 0:
            for c in range(9):
                turned[i, c] = q[c]


@numba.njit(cache=True, error_model="numpy")
def _backward(
    position, quaternion, log_scale, logit, dc, blend, binding, frame_rows, neighbours, rows, blended,
    g_centre, g_u, g_v, g_opacity, g_colour, d_position, d_quaternion, d_log_scale, d_logit, d_dc, d_blend,
):  # fmt: skip
    for i in range(len(binding)):
        moved = g_opacity[i] != 0
        for n in range(3):
            moved |= g_centre[i, n] != 0 or g_u[i, n] != 0 or g_v[i, n] != 0 or g_colour[i, n] != 0
        if not moved:
            d_position[i], d_quaternion[i], d_log_scale[i], d_dc[i], d_blend[i] = 0.0, 0.0, 0.0, 0.0, 0.0
            d_logit[i] = 0.0
            continue
        own, one, two, three, turn, u, _t = _face(binding[i], neighbours, rows)
        shares, g = (1.0, 0.0, 0.0, 0.0), 1.0
        if blended:
            shares, g = shares_of(_numbers4(blend, i))
        v = (g * shares[0], g * shares[1], g * shares[2], g * shares[3])
        w, p = blended_motion(v, own, one, two, three, turn)
        a, b, c = matrix3.exponential_terms(w)
        q = matrix3.turned(u, w, a, b)
        first, second, unit, length = disc_axes(
            (quaternion[i, 0], quaternion[i, 1], quaternion[i, 2], quaternion[i, 3])
        )
        dx, dq, ds, h, y = pulled_back(
            q, p, _numbers9(frame_rows, binding[i], 0), first, second, unit, length, exp(log_scale[i, 0]),
            exp(log_scale[i, 1]), (g_centre[i, 0], g_centre[i, 1], g_centre[i, 2]), (g_u[i, 0], g_u[i, 1], g_u[i, 2]),
            (g_v[i, 0], g_v[i, 1], g_v[i, 2]), (position[i, 0], position[i, 1], position[i, 2]),
        )  # fmt: skip
        opacity = sigmoid(logit[i])
        d_logit[i] = g_opacity[i] * opacity * (1 - opacity)
        d_log_scale[i, 0], d_log_scale[i, 1] = ds
        for n in range(3):
            d_position[i, n], d_dc[i, n] = dx[n], SH_BASE * g_colour[i, n]
        for n in range(4):
            d_quaternion[i, n], d_blend[i, n] = dq[n], 0.0
        if blended:
            # The tangents' axes before their scales: those are in h already.
            dturn = turn_gradient(w, b, c, p, h[0], h[1], h[2], y[0], y[1], y[2])
            dp = stretch_gradient(h[0], h[1], h[2], y[0], y[1], y[2])
            db = blend_gradient(shares, g, dturn, dp, own, one, two, three, turn)
            for n in range(4):
                d_blend[i, n] = db[n]


# Sixteen surfels at a time; the last sixteen overlap the ones before, which are then computed twice.


@inner
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


@inner
def _weights_of(blend, i, blended):
    if blended:
        return shares_of(load4(blend, 4 * i))
    one, none = splat(np.float32(1)), splat(np.float32(0))
    return (one, none, none, none), one


@inner
def _size(v):
    return absolute(v[0]) + absolute(v[1]) + absolute(v[2])


@inner
def _unless4(condition, v):
    none = splat(np.float32(0))
    return (
        select(condition, none, v[0]), select(condition, none, v[1]),
        select(condition, none, v[2]), select(condition, none, v[3]),
    )  # fmt: skip


@inner
def _forward_sixteen(
    i, position, quaternion, log_scale, logit, dc, blend, binding, frame_rows, neighbours, rows, blended,
    centre, tangent_u, tangent_v, opacity, colour, turned, around,
):  # fmt: skip
    align_stack()
    own, one, two, three, turn, u, t, k = _faces(i, binding, frame_rows, neighbours, rows, around)
    shares, g = _weights_of(blend, i, blended)
    v = (g * shares[0], g * shares[1], g * shares[2], g * shares[3])
    w, p = blended_motion(v, own, one, two, three, turn)
    a, b, _c = matrix3.exponential_terms(w)
    q = matrix3.turned(u, w, a, b)
    first, second, _unit, _length = disc_axes(load4(quaternion, 4 * i))
    scale = load2(log_scale, 2 * i)
    x, tu, tv = carried(q, p, k, load3(position, 3 * i), first, second, exp(scale[0]), exp(scale[1]))
    store3(centre, 3 * i, (x[0] + t[0], x[1] + t[1], x[2] + t[2]))
    store3(tangent_u, 3 * i, tu)
    store3(tangent_v, 3 * i, tv)
    rgb = load3(dc, 3 * i)
    store3(colour, 3 * i, (0.5 + SH_BASE * rgb[0], 0.5 + SH_BASE * rgb[1], 0.5 + SH_BASE * rgb[2]))
    store(opacity, i, sigmoid(load(logit, i)))
    if len(turned) > 0:
        store9(turned, 9 * i, q)


@inner
def _backward_sixteen(
    i, position, quaternion, log_scale, logit, dc, blend, binding, frame_rows, neighbours, rows, blended,
    g_centre, g_u, g_v, g_opacity, g_colour, d_position, d_quaternion, d_log_scale, d_logit, d_dc, d_blend, around,
):  # fmt: skip
    align_stack()
    up_x, up_u, up_v, rgb = load3(g_centre, 3 * i), load3(g_u, 3 * i), load3(g_v, 3 * i), load3(g_colour, 3 * i)
    none = splat(np.float32(0))
    still = _size(up_x) + _size(up_u) + _size(up_v) + _size(rgb) + absolute(load(g_opacity, i)) <= none
    own, one, two, three, turn, u, _t, k = _faces(i, binding, frame_rows, neighbours, rows, around)
    shares, g = _weights_of(blend, i, blended)
    v = (g * shares[0], g * shares[1], g * shares[2], g * shares[3])
    w, p = blended_motion(v, own, one, two, three, turn)
    a, b, c = matrix3.exponential_terms(w)
    q = matrix3.turned(u, w, a, b)
    first, second, unit, length = disc_axes(load4(quaternion, 4 * i))
    scale = load2(log_scale, 2 * i)
    dx, dq, ds, h, y = pulled_back(
        q, p, k, first, second, unit, length, exp(scale[0]), exp(scale[1]), up_x, up_u, up_v, load3(position, 3 * i)
    )
    store3(d_position, 3 * i, (select(still, none, dx[0]), select(still, none, dx[1]), select(still, none, dx[2])))
    store4(d_quaternion, 4 * i, _unless4(still, dq))
    store2(d_log_scale, 2 * i, (select(still, none, ds[0]), select(still, none, ds[1])))
    opacity = sigmoid(load(logit, i))
    store(d_logit, i, select(still, none, load(g_opacity, i) * opacity * (1 - opacity)))
    store3(d_dc, 3 * i, (SH_BASE * rgb[0], SH_BASE * rgb[1], SH_BASE * rgb[2]))
    db = (none, none, none, none)
    if blended:
        dturn = turn_gradient(w, b, c, p, h[0], h[1], h[2], y[0], y[1], y[2])
        dp = stretch_gradient(h[0], h[1], h[2], y[0], y[1], y[2])
        db = blend_gradient(shares, g, dturn, dp, own, one, two, three, turn)
    store4(d_blend, 4 * i, _unless4(still, db))


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _forward_vectors(
    position, quaternion, log_scale, logit, dc, blend, binding, frame_rows, neighbours, rows, blended,
    centre, tangent_u, tangent_v, opacity, colour, turned,
):  # fmt: skip
    n = len(binding)
    for part in numba.prange((n + PART - 1) // PART):
        around = np.empty(3 * WIDTH, np.int32)
        for start in range(part * PART, min((part + 1) * PART, n), WIDTH):
            _forward_sixteen(
                min(start, n - WIDTH), position, quaternion, log_scale, logit, dc, blend, binding, frame_rows,
                neighbours, rows, blended, centre, tangent_u, tangent_v, opacity, colour, turned, around,
            )  # fmt: skip


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _backward_vectors(
    position, quaternion, log_scale, logit, dc, blend, binding, frame_rows, neighbours, rows, blended,
    g_centre, g_u, g_v, g_opacity, g_colour, d_position, d_quaternion, d_log_scale, d_logit, d_dc, d_blend,
):  # fmt: skip
    n = len(binding)
    for part in numba.prange((n + PART - 1) // PART):
        around = np.empty(3 * WIDTH, np.int32)
        for start in range(part * PART, min((part + 1) * PART, n), WIDTH):
            _backward_sixteen(
                min(start, n - WIDTH), position, quaternion, log_scale, logit, dc, blend, binding, frame_rows,
                neighbours, rows, blended, g_centre, g_u, g_v, g_opacity, g_colour,
                d_position, d_quaternion, d_log_scale, d_logit, d_dc, d_blend, around,
            )  # fmt: skip
