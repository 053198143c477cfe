"""Local -> world: surfels carried by their triangles through Jacobian blend skinning, with exact gradients.

World centre  J_b (k_c R_c mu) + T,  tangents  J_b k_c R_c r S,  where  J_b = U exp(sum v_i log(U^T U_i)) sum v_i P_i
blends the motions of the own face and its three neighbours.  SurFhead blends absolute rotation vectors, which wraps
where the head turns by pi; relative to the own face it does not.  One Numba kernel each way: in plain torch this would
cost more than the rasteriser, and its exp would round differently with the number of threads.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from carigs.splat import matrix3
from carigs.splat.rig import FaceMotion, Rig
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
    mesh = (rig.frame, rig.neighbours, *motion)
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


class _Skin(torch.autograd.Function):
    @staticmethod
    def forward(ctx, position, rotation, log_scale, opacity, colour, blend, binding, mesh, blended, rotations):
        n, dtype = len(binding), position.detach().numpy().dtype
        leaves = tuple(t.detach().numpy() for t in (position, rotation, log_scale, opacity, colour, blend))
        out = (*(np.empty((n, 3), dtype) for _ in range(3)), np.empty(n, dtype), np.empty((n, 3), dtype))
        weight, scale = np.empty((n, 4), dtype), np.empty((n, 2), dtype)
        turned = np.empty((n if rotations else 0, 3, 3), dtype)
        _forward(*leaves, binding, *mesh, blended, *out, weight, scale, turned)
        ctx.kept = (*leaves, binding, *mesh, blended, weight, scale, out[3])
        ctx.set_materialize_grads(True)
        outputs = tuple(torch.from_numpy(array) for array in out)
        if not rotations:
            return *outputs, None
        rotation_out = torch.from_numpy(turned)
        ctx.mark_non_differentiable(rotation_out)
        return *outputs, rotation_out

    @staticmethod
    def backward(ctx, centre, tangent_u, tangent_v, opacity, colour, _rotation):
        given = tuple(g.contiguous().numpy() for g in (centre, tangent_u, tangent_v, opacity, colour))
        gradients = tuple(np.empty_like(leaf) for leaf in ctx.kept[:6])
        _backward(*ctx.kept, *given, *gradients)
        return *(torch.from_numpy(g) for g in gradients), None, None, None, None


@numba.njit(cache=True)
def _sigmoid(x):
    return 1.0 / (1.0 + math.exp(-x))


@numba.njit(cache=True)
def _disc_axes(quaternion, i):
    """First two columns of the rotation matrix, the unit quaternion and the inverse of its length."""
    w, x, y, z = quaternion[i, 0], quaternion[i, 1], quaternion[i, 2], quaternion[i, 3]
    g = 1.0 / math.sqrt(max(w * w + x * x + y * y + z * z, 1e-30))
    w, x, y, z = w * g, x * g, y * g, z * g
    first = (1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y))
    second = (2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x))
    return first, second, (w, x, y, z), g


@numba.njit(cache=True)
def _blended(f, v0, v1, v2, v3, neighbours, stretch, turn):
    """Blended rotation vector (relative to the own face) and stretch."""
    i, j, k = neighbours[f, 0], neighbours[f, 1], neighbours[f, 2]
    w = (
        v1 * turn[f, 0, 0] + v2 * turn[f, 1, 0] + v3 * turn[f, 2, 0],
        v1 * turn[f, 0, 1] + v2 * turn[f, 1, 1] + v3 * turn[f, 2, 1],
        v1 * turn[f, 0, 2] + v2 * turn[f, 1, 2] + v3 * turn[f, 2, 2],
    )
    p = (
        v0 * stretch[f, 0] + v1 * stretch[i, 0] + v2 * stretch[j, 0] + v3 * stretch[k, 0],
        v0 * stretch[f, 1] + v1 * stretch[i, 1] + v2 * stretch[j, 1] + v3 * stretch[k, 1],
        v0 * stretch[f, 2] + v1 * stretch[i, 2] + v2 * stretch[j, 2] + v3 * stretch[k, 2],
        v0 * stretch[f, 3] + v1 * stretch[i, 3] + v2 * stretch[j, 3] + v3 * stretch[k, 3],
        v0 * stretch[f, 4] + v1 * stretch[i, 4] + v2 * stretch[j, 4] + v3 * stretch[k, 4],
        v0 * stretch[f, 5] + v1 * stretch[i, 5] + v2 * stretch[j, 5] + v3 * stretch[k, 5],
    )
    return w, p


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _forward(
    position, quaternion, log_scale, logit, dc, blend, binding, frame, neighbours, face_centre, rotation, stretch, turn,
    blended, centre, tangent_u, tangent_v, opacity, colour, weight, scale, turned,
):  # fmt: skip
    for i in numba.prange(len(binding)):
        f = binding[i]
        w0, w1, w2, w3 = 1.0, 0.0, 0.0, 0.0
        if blended:
            w0, w1, w2, w3 = _sigmoid(blend[i, 0]), _sigmoid(blend[i, 1]), _sigmoid(blend[i, 2]), _sigmoid(blend[i, 3])
        weight[i, 0], weight[i, 1], weight[i, 2], weight[i, 3] = w0, w1, w2, w3
        g = 1.0 / (w0 + w1 + w2 + w3)
        w, p = _blended(f, g * w0, g * w1, g * w2, g * w3, neighbours, stretch, turn)
        a, b, _c = matrix3.exponential_terms(w)
        q = matrix3.turned(matrix3.load(rotation, f), w, a, b)
        k = matrix3.load(frame, f)
        first, second, _unit, _length = _disc_axes(quaternion, i)
        s, t = math.exp(log_scale[i, 0]), math.exp(log_scale[i, 1])
        x = matrix3.apply(
            q, matrix3.apply_symmetric(p, matrix3.apply(k, (position[i, 0], position[i, 1], position[i, 2])))
        )
        u = matrix3.apply(q, matrix3.apply_symmetric(p, matrix3.apply(k, first)))
        v = matrix3.apply(q, matrix3.apply_symmetric(p, matrix3.apply(k, second)))
        for c in range(3):
            centre[i, c] = x[c] + face_centre[f, c]
            tangent_u[i, c] = s * u[c]
            tangent_v[i, c] = t * v[c]
            colour[i, c] = 0.5 + SH_BASE * dc[i, c]
        scale[i, 0], scale[i, 1] = s, t
        opacity[i] = _sigmoid(logit[i])
        if len(turned) > 0:
            matrix3.store(turned, i, q)


@numba.njit(cache=True, parallel=True, error_model="numpy")
def _backward(
    position, quaternion, log_scale, logit, dc, blend, binding, frame, neighbours, face_centre, rotation, stretch, turn,
    blended, weight, scale, opacity, g_centre, g_u, g_v, g_opacity, g_colour,
    d_position, d_quaternion, d_log_scale, d_logit, d_dc, d_blend,
):  # fmt: skip
    for i in numba.prange(len(binding)):
        f = binding[i]
        w0, w1, w2, w3 = weight[i, 0], weight[i, 1], weight[i, 2], weight[i, 3]
        g = 1.0 / (w0 + w1 + w2 + w3)
        w, p = _blended(f, g * w0, g * w1, g * w2, g * w3, neighbours, stretch, turn)
        a, b, c = matrix3.exponential_terms(w)
        q = matrix3.turned(matrix3.load(rotation, f), w, a, b)
        k = matrix3.load(frame, f)
        first, second, unit, length = _disc_axes(quaternion, i)
        s, t = scale[i, 0], scale[i, 1]
        # Gradients in the frame after the stretch, the canonical vectors before it, and gradients there.
        hx = matrix3.apply_transposed(q, (g_centre[i, 0], g_centre[i, 1], g_centre[i, 2]))
        hu = matrix3.apply_transposed(q, (s * g_u[i, 0], s * g_u[i, 1], s * g_u[i, 2]))
        hv = matrix3.apply_transposed(q, (t * g_v[i, 0], t * g_v[i, 1], t * g_v[i, 2]))
        x, u, v = (
            matrix3.apply(k, (position[i, 0], position[i, 1], position[i, 2])),
            matrix3.apply(k, first),
            matrix3.apply(k, second),
        )
        du, dv = (
            matrix3.apply_transposed(k, matrix3.apply_symmetric(p, hu)),
            matrix3.apply_transposed(k, matrix3.apply_symmetric(p, hv)),
        )
        dx = matrix3.apply_transposed(k, matrix3.apply_symmetric(p, hx))
        d_position[i, 0], d_position[i, 1], d_position[i, 2] = dx
        d_log_scale[i, 0], d_log_scale[i, 1] = matrix3.dot(first, du), matrix3.dot(second, dv)
        d_logit[i] = g_opacity[i] * opacity[i] * (1 - opacity[i])
        for n in range(3):
            d_dc[i, n] = SH_BASE * g_colour[i, n]
        qw, qx, qy, qz = unit
        dw = 2 * (qz * du[1] - qy * du[2] - qz * dv[0] + qx * dv[2])
        dqx = 2 * (qy * du[1] + qz * du[2] + qy * dv[0] - 2 * qx * dv[1] + qw * dv[2])
        dqy = 2 * (-2 * qy * du[0] + qx * du[1] - qw * du[2] + qx * dv[0] + qz * dv[2])
        dqz = 2 * (-2 * qz * du[0] + qw * du[1] + qx * du[2] - qw * dv[0] - 2 * qz * dv[1] + qy * dv[2])
        along = dw * qw + dqx * qx + dqy * qy + dqz * qz
        d_quaternion[i, 0], d_quaternion[i, 1] = length * (dw - along * qw), length * (dqx - along * qx)
        d_quaternion[i, 2], d_quaternion[i, 3] = length * (dqy - along * qy), length * (dqz - along * qz)
        if not blended:
            d_blend[i] = 0
            continue
        # d(Q y) = Q (Jr dw x y): torque of the gradients, then the right Jacobian's transpose I + b [w] + c [w]^2.
        torque_x, torque_u = (
            matrix3.cross(matrix3.apply_symmetric(p, x), hx),
            matrix3.cross(matrix3.apply_symmetric(p, u), hu),
        )
        torque_v = matrix3.cross(matrix3.apply_symmetric(p, v), hv)
        torque = (
            torque_x[0] + torque_u[0] + torque_v[0],
            torque_x[1] + torque_u[1] + torque_v[1],
            torque_x[2] + torque_u[2] + torque_v[2],
        )
        once = matrix3.cross(w, torque)
        twice = matrix3.cross(w, once)
        dturn = (
            torque[0] + b * once[0] + c * twice[0],
            torque[1] + b * once[1] + c * twice[1],
            torque[2] + b * once[2] + c * twice[2],
        )
        dp = (
            hx[0] * x[0] + hu[0] * u[0] + hv[0] * v[0],
            hx[0] * x[1] + hx[1] * x[0] + hu[0] * u[1] + hu[1] * u[0] + hv[0] * v[1] + hv[1] * v[0],
            hx[0] * x[2] + hx[2] * x[0] + hu[0] * u[2] + hu[2] * u[0] + hv[0] * v[2] + hv[2] * v[0],
            hx[1] * x[1] + hu[1] * u[1] + hv[1] * v[1],
            hx[1] * x[2] + hx[2] * x[1] + hu[1] * u[2] + hu[2] * u[1] + hv[1] * v[2] + hv[2] * v[1],
            hx[2] * x[2] + hu[2] * u[2] + hv[2] * v[2],
        )
        dv0, dv1, dv2, dv3 = (
            0.0,
            matrix3.dot(dturn, turn[f, 0]),
            matrix3.dot(dturn, turn[f, 1]),
            matrix3.dot(dturn, turn[f, 2]),
        )
        n1, n2, n3 = neighbours[f, 0], neighbours[f, 1], neighbours[f, 2]
        for n in range(6):
            dv0 += dp[n] * stretch[f, n]
            dv1 += dp[n] * stretch[n1, n]
            dv2 += dp[n] * stretch[n2, n]
            dv3 += dp[n] * stretch[n3, n]
        mean = g * (w0 * dv0 + w1 * dv1 + w2 * dv2 + w3 * dv3)
        d_blend[i, 0], d_blend[i, 1] = g * w0 * (1 - w0) * (dv0 - mean), g * w1 * (1 - w1) * (dv1 - mean)
        d_blend[i, 2], d_blend[i, 3] = g * w2 * (1 - w2) * (dv2 - mean), g * w3 * (1 - w3) * (dv3 - mean)
