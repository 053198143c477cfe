"""Jacobian blend skinning (paper equation 6): surfels from triangle-local to world coordinates, with exact gradients.

The formulas are in `jacobian_blend`. This module holds the PyTorch function and the loops over single surfels, which
serve float64 (tests) and fewer than sixteen surfels; `skinning_simd` holds the loops over sixteen surfels at a time.
A surfel whose upstream gradients are all zero gets zero gradients, also where its attributes are not finite. In plain
PyTorch this would take longer than the rasteriser, and its exponential rounds differently with the number of threads.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float
from torch import Tensor

from carigs.simd.kernels import kernel
from carigs.simd.memory import flattened
from carigs.simd.tuples import write_row
from carigs.simd.vectors import WIDTH
from carigs.splat.rig import jacobian_blend as jbs
from carigs.splat.rig import jacobian_blend_backward as backward
from carigs.splat.rig import mesh_gradient, skinning_simd
from carigs.splat.rig.face_motion import FaceMotion
from carigs.splat.rig.rig import Rig
from carigs.splat.rig.skinning_arguments import (
    AttributeGradients,
    MotionParts,
    SkinnedArrays,
    SkinningInputs,
    has_gradient,
    read3,
    read4,
    read_blend,
    read_scale,
    surfel_gradient,
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
    opacity: Float[Tensor, " n"]
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
    triangle, so that k_c R_c stands between J_b and each of them. On the triangles of `Rig.keeps_size` the two axes of
    the disc do not stretch: the rotation of J_b alone acts on them.

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
            skinning_simd.skin(n, flattened(ctx.inputs), flattened(skinned))
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
        parts = None
        if ctx.needs_input_grad[5]:
            parts = MotionParts(
                *(np.empty((n, columns), upstream.centre.dtype) for columns in (4, 3, 3, 3, 3, 3, 3, 3))
            )
        _backward(ctx.inputs, ctx.centre, upstream, gradients, parts, ctx.vectors)
        d_records = None
        if parts is not None:
            total = mesh_gradient.sum_of_parts(ctx.inputs.binding, ctx.inputs.neighbours, parts)
            d_records = torch.from_numpy(total.astype(ctx.inputs.records.dtype))
        return *(torch.from_numpy(g) for g in gradients), d_records, None, None, None, None


def _backward(
    inputs: SkinningInputs,
    centre: Float[np.ndarray, "n 3"],
    upstream: SkinnedArrays,
    gradients: AttributeGradients,
    parts: MotionParts | None,
    vectors: bool,
) -> None:
    """Write the gradients of the surfels and, unless it is None, what each adds to those of the motion's records."""
    if not vectors:
        skin_scalar_backward(inputs, centre, upstream, gradients)
        if parts is not None:
            mesh_gradient.motion_parts(inputs, centre, upstream, parts)
        return
    arguments = (len(centre), flattened(inputs), centre.reshape(-1), flattened(upstream), flattened(gradients))
    if parts is None:
        skinning_simd.skin_backward(*arguments)
    else:
        skinning_simd.skin_and_motion_backward(*arguments, flattened(parts))


@kernel
def skin_scalar(inputs, skinned):
    """Skin the surfels one by one.

    Args:
        inputs: `SkinningInputs`.
        skinned: `SkinnedArrays` to write; directions only if there is room for them.
    """
    for i in range(len(inputs.binding)):
        _faces, t, frame, _sigmoids, _inverse_sum, blend = read_blend(i, inputs)
        axes = jbs.disc_axes(read4(inputs.quaternion, i))
        x, u, v = jbs.skin_surfel(blend, frame, t, read3(inputs.position, i), axes, read_scale(i, inputs))
        write_row(skinned.centre, i, x)
        write_row(skinned.tangent_u, i, u)
        write_row(skinned.tangent_v, i, v)
        skinned.opacity[i] = jbs.sigmoid(inputs.logit[i])
        if len(skinned.direction) > 0:
            _n, _g, d = jbs.view_direction(blend[4], read3(skinned.centre, i), inputs.eye, inputs.rotate_directions)
            write_row(skinned.direction, i, d)


@kernel
def skin_scalar_backward(inputs, centre, upstream, gradients):
    """Backward pass of `skin_scalar`.

    Args:
        inputs: `SkinningInputs`.
        centre: World centres that `skin_scalar` wrote.
        upstream: `SkinnedArrays` of gradients with respect to what `skin_scalar` wrote.
        gradients: `AttributeGradients` to write.
    """
    for i in range(len(inputs.binding)):
        if not has_gradient(i, upstream):
            gradients.position[i], gradients.quaternion[i], gradients.log_scale[i] = 0.0, 0.0, 0.0
            gradients.logit[i], gradients.blend[i] = 0.0, 0.0
            continue
        faces, _t, frame, sigmoids, inverse_sum, blend = read_blend(i, inputs)
        (dx, dq, ds, h, y), (_gx, torque, _n) = surfel_gradient(i, inputs, centre, upstream, frame, blend)
        opacity = jbs.sigmoid(inputs.logit[i])
        gradients.logit[i] = upstream.opacity[i] * opacity * (1 - opacity)
        write_row(gradients.position, i, dx)
        write_row(gradients.quaternion, i, dq)
        write_row(gradients.log_scale, i, ds)
        db = (0.0, 0.0, 0.0, 0.0)
        if inputs.blended:
            d_w, d_p = backward.motion_gradient(blend, h, y, torque)
            db = backward.blend_gradient(sigmoids, inverse_sum, d_w, d_p, faces)
        write_row(gradients.blend, i, db)
