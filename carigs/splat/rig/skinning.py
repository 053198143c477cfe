"""Local -> world: surfels carried by their triangles through Jacobian blend skinning, with exact gradients.

World centre  J_b (k_c R_c mu) + T,  tangents  J_b k_c R_c r S,  where  J_b = U exp(sum v_i log(U^T U_i)) sum v_i P_i
blends the motions of the own face and its three neighbours.  SurFhead blends absolute rotation vectors, which wraps
where the head turns by pi; relative to the own face it does not.

The formulas are in `jacobian_blend`; here are the loops for one surfel after the other, which is how the tests check
them in float64, and in `skinning_simd` those for sixteen.  What no pixel depends on has no gradient, whatever its
numbers are (0 * NaN).  In plain torch this would cost more than the rasteriser, and its exp would round differently
with the number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from carigs.simd.vector_math import exp
from carigs.simd.vectors import WIDTH
from carigs.splat.rig import skinning_simd
from carigs.splat.rig.face_motion import FaceMotion, read3, read4, read9, read_blend
from carigs.splat.rig.jacobian_blend import (
    blend_gradient,
    carried,
    direction_gradient,
    disc_axes,
    pulled_back,
    sigmoid,
    stretch_gradient,
    torque_of,
    turn_gradient,
    view_direction,
)
from carigs.splat.rig.mesh_gradient import rows_gradient
from carigs.splat.rig.rig import Rig
from carigs.splat.surfels.surfels import Surfels


class Skinned(NamedTuple):
    """Surfels in the world, differentiable."""

    centre: Float[Tensor, "n 3"]
    tangent_u: Float[Tensor, "n 3"]
    """World vectors as long as the standard deviations (metres)."""
    tangent_v: Float[Tensor, "n 3"]
    opacity: Float[Tensor, "n"]
    direction: Float[Tensor, "n 3"] | None
    """Unit vector from the eye to the centre; only where an eye is given."""


def skin(
    surfels: Surfels,
    rig: Rig,
    motion: FaceMotion,
    *,
    blend: bool = True,
    eye: Float[np.ndarray, "3"] | None = None,
    turning: bool = True,
) -> Skinned:
    """Carry the surfels to the posed mesh; without `blend` by their own face's Jacobian alone.

    With an `eye` (world point in metres) also say whence each is seen: with `turning` in the axes of the canonical
    head, which the blended rotation turns, else in the world's.  Differentiable with respect to the surfels, and to
    the motion where its rows are a tensor.
    """
    rows = motion.rows if isinstance(motion.rows, Tensor) else torch.from_numpy(motion.rows)
    leaves = (surfels.position, surfels.rotation, surfels.log_scale, surfels.opacity, surfels.blend)
    place = None if eye is None else tuple(float(c) for c in eye)
    mesh = (surfels.binding, rig.frame_rows, rig.neighbours)
    return Skinned(*_Skin.apply(*leaves, rows, mesh, blend, place, turning))


class _Skin(torch.autograd.Function):
    @staticmethod
    def forward(ctx, position, rotation, log_scale, opacity, blend, rows, mesh, blended, eye, turning):
        leaves = [t.detach().contiguous().numpy() for t in (position, rotation, log_scale, opacity, blend)]
        n, dtype = len(position), leaves[0].dtype
        out = [np.empty(shape, dtype) for shape in ((n, 3), (n, 3), (n, 3), n, (n if eye else 0, 3))]
        ctx.vectors = dtype == np.float32 and n >= WIDTH
        ctx.kept = [*leaves, *mesh, rows.detach().numpy(), blended, eye or (0.0, 0.0, 0.0), turning, out[0]]
        ctx.seen = eye is not None
        if ctx.vectors:
            skinning_simd.skin(n, *_flat(ctx.kept), *_flat(out[1:]))
        else:
            skin_each(*ctx.kept, *out[1:])
        ctx.set_materialize_grads(True)
        tensors = [torch.from_numpy(array) for array in out]
        return *tensors[:4], tensors[4] if ctx.seen else None

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, *given):
        given = [g.contiguous().numpy() for g in given[:4]] + [
            given[4].contiguous().numpy() if ctx.seen else np.empty((0, 3), given[0].numpy().dtype)
        ]
        n = len(given[0])
        shapes = ((n, 3), (n, 4), (n, 2), (n,), (n, 4))
        gradients = [np.empty(shape, given[0].dtype) for shape in shapes]
        if ctx.vectors:
            skinning_simd.skin_backward(n, *_flat(ctx.kept), *_flat(given), *_flat(gradients))
        else:
            skin_each_backward(*ctx.kept, *given, *gradients)
        d_rows = None
        if ctx.needs_input_grad[5]:
            d_rows = torch.from_numpy(rows_gradient(*ctx.kept, *given).astype(ctx.kept[8].dtype))
        return *(torch.from_numpy(g) for g in gradients), d_rows, None, None, None, None


def _flat(values):
    return [v.reshape(-1) if isinstance(v, np.ndarray) else v for v in values]


@numba.njit(cache=True, error_model="numpy")
def skin_each(
    position, quaternion, log_scale, logit, blend, binding, frame_rows, neighbours, rows, blended, eye, turning,
    centre, tangent_u, tangent_v, opacity, direction,
):  # fmt: skip
    """The world's surfels from the triangles', one by one."""
    for i in range(len(binding)):
        _faces, t, _shares, _g, _v, _w, p, _terms, q = read_blend(i, blend, binding, neighbours, rows, blended)
        first, second, _unit, _length = disc_axes(read4(quaternion, i))
        x, tu, tv = carried(
            q, p, read9(frame_rows, binding[i], 0), read3(position, i), first, second, exp(log_scale[i, 0]),
            exp(log_scale[i, 1]),
        )  # fmt: skip
        for c in range(3):
            centre[i, c], tangent_u[i, c], tangent_v[i, c] = x[c] + t[c], tu[c], tv[c]
        opacity[i] = sigmoid(logit[i])
        if len(direction) > 0:
            _n, _g, d = view_direction(q, read3(centre, i), eye, turning)
            direction[i, 0], direction[i, 1], direction[i, 2] = d


@numba.njit(cache=True, error_model="numpy")
def skin_each_backward(
    position, quaternion, log_scale, logit, blend, binding, frame_rows, neighbours, rows, blended, eye, turning,
    centre, g_centre, g_u, g_v, g_opacity, g_direction,
    d_position, d_quaternion, d_log_scale, d_logit, d_blend,
):  # fmt: skip
    """From the gradients of what `skin_each` wrote to those of what it read."""
    seen = len(g_direction) > 0
    for i in range(len(binding)):
        moved = g_opacity[i] != 0
        for n in range(3):
            moved |= g_centre[i, n] != 0 or g_u[i, n] != 0 or g_v[i, n] != 0
            moved |= seen and g_direction[i, n] != 0
        if not moved:
            d_position[i], d_quaternion[i], d_log_scale[i], d_logit[i], d_blend[i] = 0.0, 0.0, 0.0, 0.0, 0.0
            continue
        faces, _t, shares, g, _v, w, p, (_a, b, c), q = read_blend(i, blend, binding, neighbours, rows, blended)
        first, second, unit, length = disc_axes(read4(quaternion, i))
        gx, torque = read3(g_centre, i), (0.0, 0.0, 0.0)
        if seen:
            n_, near, d = view_direction(q, read3(centre, i), eye, turning)
            more, torque = direction_gradient(q, n_, near, d, read3(g_direction, i), turning)
            gx = (gx[0] + more[0], gx[1] + more[1], gx[2] + more[2])
        dx, dq, ds, h, y = pulled_back(
            q, p, read9(frame_rows, binding[i], 0), first, second, unit, length, exp(log_scale[i, 0]),
            exp(log_scale[i, 1]), gx, read3(g_u, i), read3(g_v, i), read3(position, i),
        )  # fmt: skip
        opacity = sigmoid(logit[i])
        d_logit[i] = g_opacity[i] * opacity * (1 - opacity)
        d_log_scale[i, 0], d_log_scale[i, 1] = ds
        for n in range(3):
            d_position[i, n] = dx[n]
        for n in range(4):
            d_quaternion[i, n], d_blend[i, n] = dq[n], 0.0
        if blended:
            # The tangents' axes before their scales: those are in h already.
            own_torque = torque_of(p, h, y)
            torque = (torque[0] + own_torque[0], torque[1] + own_torque[1], torque[2] + own_torque[2])
            dturn, dp = turn_gradient(w, b, c, torque), stretch_gradient(h, y)
            db = blend_gradient(shares, g, dturn, dp, *faces)
            for n in range(4):
                d_blend[i, n] = db[n]
