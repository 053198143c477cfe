"""Jacobian blend skinning (paper equation 6): surfels from triangle-local to world coordinates, with exact gradients.

The formulas are in `jacobian_blend`. This module holds the PyTorch function and the loops over single surfels, which
serve float64 (tests) and fewer than sixteen surfels; `skinning_simd` holds the loops over sixteen surfels at a time.
A surfel whose upstream gradients are all zero gets zero gradients, also where its attributes are not finite. In plain
PyTorch this would take longer than the rasteriser, and its exponential rounds differently with the number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from carigs.simd.vector_math import exp
from carigs.simd.vectors import WIDTH, scalar_or_simd
from carigs.splat.rig import jacobian_blend as jbs
from carigs.splat.rig import jacobian_blend_backward as backward
from carigs.splat.rig import skinning_simd
from carigs.splat.rig.face_motion import FaceMotion
from carigs.splat.rig.mesh_gradient import record_gradients
from carigs.splat.rig.rig import Rig
from carigs.splat.rig.skinning_arguments import (
    AttributeGradients,
    SkinnedArrays,
    SkinningInputs,
    read3,
    read4,
    read_blend,
)
from carigs.splat.surfels.surfels import Surfels


class SkinnedSurfels(NamedTuple):
    """Surfels in world coordinates, differentiable.

    Attributes:
        centre: World position in metres.
        tangent_u: First axis of the disc in world coordinates; its length is the standard deviation in metres.
        tangent_v: Second axis.
        opacity: In [0, 1].
        direction: Unit vector from the camera to the centre; None without a camera.
    """

    centre: Float[Tensor, "n 3"]
    tangent_u: Float[Tensor, "n 3"]
    tangent_v: Float[Tensor, "n 3"]
    opacity: Float[Tensor, "n"]
    direction: Float[Tensor, "n 3"] | None


def jacobian_blend_skinning(
    surfels: Surfels,
    rig: Rig,
    motion: FaceMotion,
    *,
    blend: bool = True,
    eye: Float[np.ndarray, "3"] | None = None,
    rotate_directions: bool = True,
) -> SkinnedSurfels:
    """Carry the surfels to the posed mesh by Jacobian blend skinning.

    Paper equation 6, with the polar decomposition J_i = U_i P_i of every triangle and weights v_i that sum to one:

        Sigma^(1/2) = J_b r s,    mu' = J_b mu + T,    J_b = exp(sum_i v_i log(U_i)) sum_i v_i P_i

    with two differences: the rotations are blended relative to that of the own triangle, U exp(sum_i v_i log(U^T U_i)),
    which does not jump where the head turns by pi; and mu, r, s are given in the canonical frame k_c R_c of the
    triangle, so that k_c R_c stands between J_b and each of them.

    Differentiable with respect to the surfels, and with respect to the motion if its records are a tensor.

    Args:
        surfels: Surfels in the frames of the triangles.
        rig: Canonical mesh.
        motion: Motion of the triangles to the posed mesh.
        blend: Whether neighbours are blended; if not, the own triangle's Jacobian acts alone.
        eye: Centre of the camera in world coordinates (metres); view directions are computed only if it is given.
        rotate_directions: Whether view directions are given in the axes of the canonical head, so that view-dependent
            colour turns with the head; if not, in world axes.

    Returns:
        The surfels in world coordinates.
    """
    records = motion.records if isinstance(motion.records, Tensor) else torch.from_numpy(motion.records)
    leaves = (surfels.position, surfels.rotation, surfels.log_scale, surfels.opacity, surfels.blend)
    point = None if eye is None else tuple(float(c) for c in eye)
    mesh = (surfels.binding, rig.frame_records, rig.neighbours)
    return SkinnedSurfels(*_Skinning.apply(*leaves, records, mesh, blend, point, rotate_directions))


class _Skinning(torch.autograd.Function):
    @staticmethod
    def forward(ctx, position, rotation, log_scale, opacity, blend, records, mesh, blended, eye, rotate):
        leaves = [t.detach().contiguous().numpy() for t in (position, rotation, log_scale, opacity, blend)]
        n, dtype = len(position), leaves[0].dtype
        skinned = SkinnedArrays(
            *(np.empty(shape, dtype) for shape in ((n, 3), (n, 3), (n, 3), n, (n if eye else 0, 3)))
        )
        ctx.vectors = dtype == np.float32 and n >= WIDTH
        ctx.inputs = SkinningInputs(*leaves, *mesh, records.detach().numpy(), blended, eye or (0.0, 0.0, 0.0), rotate)
        ctx.centre, ctx.has_eye = skinned.centre, eye is not None
        if ctx.vectors:
            skinning_simd.skin(n, _flat(ctx.inputs), _flat(skinned))
        else:
            skin_scalar(ctx.inputs, skinned)
        ctx.set_materialize_grads(True)
        tensors = [torch.from_numpy(array) for array in skinned]
        return *tensors[:4], tensors[4] if ctx.has_eye else None

    @staticmethod
    @torch.autograd.function.once_differentiable
    def backward(ctx, *upstream):
        arrays = [g.contiguous().numpy() for g in upstream[: 4 + ctx.has_eye]]
        upstream = SkinnedArrays(*arrays, *(() if ctx.has_eye else (np.empty((0, 3), arrays[0].dtype),)))
        n = len(upstream.centre)
        shapes = ((n, 3), (n, 4), (n, 2), (n,), (n, 4))
        gradients = AttributeGradients(*(np.empty(shape, upstream.centre.dtype) for shape in shapes))
        if ctx.vectors:
            centre = ctx.centre.reshape(-1)
            skinning_simd.skin_backward(n, _flat(ctx.inputs), centre, _flat(upstream), _flat(gradients))
        else:
            skin_scalar_backward(ctx.inputs, ctx.centre, upstream, gradients)
        d_records = None
        if ctx.needs_input_grad[5]:
            d_records = record_gradients(ctx.inputs, ctx.centre, upstream).astype(ctx.inputs.records.dtype)
            d_records = torch.from_numpy(d_records)
        return *(torch.from_numpy(g) for g in gradients), d_records, None, None, None, None


def _flat(group):
    return type(group)(*(v.reshape(-1) if isinstance(v, np.ndarray) else v for v in group))


@numba.njit(cache=True, error_model="numpy")
def skin_scalar(inputs, skinned):
    """Skin the surfels one by one.

    Args:
        inputs: `SkinningInputs`.
        skinned: `SkinnedArrays` to write; directions only if there is room for them.
    """
    for i in range(len(inputs.binding)):
        _faces, t, frame, _sigmoids, _inverse_sum, blend = read_blend(i, inputs)
        axes = jbs.disc_axes(read4(inputs.quaternion, i))
        scale = (exp(inputs.log_scale[i, 0]), exp(inputs.log_scale[i, 1]))
        x, u, v = jbs.skin_surfel(blend, frame, t, read3(inputs.position, i), axes, scale)
        for c in range(3):
            skinned.centre[i, c], skinned.tangent_u[i, c], skinned.tangent_v[i, c] = x[c], u[c], v[c]
        skinned.opacity[i] = jbs.sigmoid(inputs.logit[i])
        if len(skinned.direction) > 0:
            _n, _g, d = jbs.view_direction(blend[4], read3(skinned.centre, i), inputs.eye, inputs.rotate_directions)
            skinned.direction[i, 0], skinned.direction[i, 1], skinned.direction[i, 2] = d


@scalar_or_simd
def _has_gradient(i, upstream):
    moved = upstream.opacity[i] != 0
    for c in range(3):
        moved |= upstream.centre[i, c] != 0 or upstream.tangent_u[i, c] != 0 or upstream.tangent_v[i, c] != 0
        moved |= len(upstream.direction) > 0 and upstream.direction[i, c] != 0
    return moved


@numba.njit(cache=True, error_model="numpy")
def skin_scalar_backward(inputs, centre, upstream, gradients):
    """Backward pass of `skin_scalar`.

    Args:
        inputs: `SkinningInputs`.
        centre: World centres that `skin_scalar` wrote.
        upstream: `SkinnedArrays` of gradients with respect to what `skin_scalar` wrote.
        gradients: `AttributeGradients` to write.
    """
    for i in range(len(inputs.binding)):
        if not _has_gradient(i, upstream):
            gradients.position[i], gradients.quaternion[i], gradients.log_scale[i] = 0.0, 0.0, 0.0
            gradients.logit[i], gradients.blend[i] = 0.0, 0.0
            continue
        faces, _t, frame, sigmoids, inverse_sum, blend = read_blend(i, inputs)
        gx, torque = read3(upstream.centre, i), (0.0, 0.0, 0.0)
        if len(upstream.direction) > 0:
            gx, torque, _n = backward.view_direction_gradient(
                blend[4], read3(centre, i), inputs.eye, inputs.rotate_directions, read3(upstream.direction, i), gx
            )
        dx, dq, ds, h, y = backward.skin_surfel_gradient(
            blend, frame, read3(inputs.position, i), jbs.disc_axes(read4(inputs.quaternion, i)),
            (exp(inputs.log_scale[i, 0]), exp(inputs.log_scale[i, 1])),
            (gx, read3(upstream.tangent_u, i), read3(upstream.tangent_v, i)),
        )  # fmt: skip
        opacity = jbs.sigmoid(inputs.logit[i])
        gradients.logit[i] = upstream.opacity[i] * opacity * (1 - opacity)
        gradients.log_scale[i, 0], gradients.log_scale[i, 1] = ds
        gradients.position[i, 0], gradients.position[i, 1], gradients.position[i, 2] = dx
        for c in range(4):
            gradients.quaternion[i, c], gradients.blend[i, c] = dq[c], 0.0
        if inputs.blended:
            d_w, d_p = backward.motion_gradient(blend, h, y, torque)
            db = backward.blend_gradient(sigmoids, inverse_sum, d_w, d_p, faces)
            for c in range(4):
                gradients.blend[i, c] = db[c]
