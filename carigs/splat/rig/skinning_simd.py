"""Loops of `skinning` for float32, sixteen surfels at a time."""

from __future__ import annotations

import numpy as np

from carigs.simd.kernels import kernel
from carigs.simd.memory import align_stack, load, store
from carigs.simd.records import gather_rows, load2, load3, load4, store2, store3, store4
from carigs.simd.tuples import add, componentwise, multiply
from carigs.simd.vector_loops import parallel_for_vectors
from carigs.simd.vector_math import absolute, exp, select
from carigs.simd.vectors import WIDTH, broadcast, simd_inline, simd_inline_alloc
from carigs.splat.rig import jacobian_blend as jbs
from carigs.splat.rig import jacobian_blend_backward as backward
from carigs.splat.rig.face_motion import RECORD_SIZE


@simd_inline
def _gather_blend(i, inputs, around):
    """As `skinning_arguments.read_blend`, for sixteen surfels; `around` is room for the neighbours' indices."""
    for r in range(WIDTH):
        for side in range(3):
            around[side * WIDTH + r] = inputs.neighbours[3 * inputs.binding[i + r] + side]
    first = gather_rows(inputs.records, inputs.binding, i, RECORD_SIZE, 0)
    last = gather_rows(inputs.records, inputs.binding, i, RECORD_SIZE, WIDTH)
    frame = gather_rows(inputs.frames, inputs.binding, i, WIDTH, 0)
    one = gather_rows(inputs.records, around, 0, RECORD_SIZE, 0)
    two = gather_rows(inputs.records, around, WIDTH, RECORD_SIZE, 0)
    three = gather_rows(inputs.records, around, 2 * WIDTH, RECORD_SIZE, 0)
    # Numba takes slices of tuples as numbers only: the columns STRETCH, CENTRE, ROTATION and RELATIVE_ROTATION
    # of the records, and KEPT of the frames.
    faces = (first[0:6], one[0:6], two[0:6], three[0:6], last[2:11])
    sigmoids, inverse_sum = _weights(i, inputs)
    blend = jbs.blend_motion(sigmoids, inverse_sum, faces, first[9:16] + last[0:2], frame[9])
    return faces, first[6:9], frame[0:9], sigmoids, inverse_sum, blend


@simd_inline
def _weights(i, inputs):
    if inputs.blended:
        return jbs.blend_weights(load4(inputs.blend, 4 * i))
    one, zero = broadcast(np.float32(1)), broadcast(np.float32(0))
    return (one, zero, zero, zero), one


@simd_inline
def _size(v):
    return absolute(v[0]) + absolute(v[1]) + absolute(v[2])


_exp, _select = componentwise(exp), componentwise(select)


@simd_inline
def _skin(i, inputs, skinned, around):
    align_stack()
    _faces, t, frame, _sigmoids, _inverse_sum, blend = _gather_blend(i, inputs, around)
    axes, scale = jbs.disc_axes(load4(inputs.quaternion, 4 * i)), _exp(load2(inputs.log_scale, 2 * i))
    x, u, v = jbs.skin_surfel(blend, frame, t, load3(inputs.position, 3 * i), axes, scale)
    store3(skinned.centre, 3 * i, x)
    store3(skinned.tangent_u, 3 * i, u)
    store3(skinned.tangent_v, 3 * i, v)
    store(skinned.opacity, i, jbs.sigmoid(load(inputs.logit, i)))
    if len(skinned.direction) > 0:
        _n, _g, d = jbs.view_direction(blend[4], x, inputs.eye, inputs.rotate_directions)
        store3(skinned.direction, 3 * i, d)


@simd_inline
def _surfel_gradient(i, inputs, centre, upstream, around):
    """As `skinning_arguments.surfel_gradient`, for sixteen surfels.

    Returns:
        Mask of the surfels without a gradient; of `_gather_blend` the triangles, sigmoids, their inverse sum and the
        blended motion; the result of `skin_surfel_gradient`; that of `view_direction_gradient` and the gradient with
        respect to the direction.
    """
    up_x, up_u, up_v = load3(upstream.centre, 3 * i), load3(upstream.tangent_u, 3 * i), load3(upstream.tangent_v, 3 * i)
    zero = broadcast(np.float32(0))
    has_eye, nothing = len(upstream.direction) > 0, (zero, zero, zero)
    up_d, torque, view = nothing, nothing, nothing
    if has_eye:
        up_d = load3(upstream.direction, 3 * i)
    unchanged = _size(up_x) + _size(up_u) + _size(up_v) + _size(up_d) + absolute(load(upstream.opacity, i)) <= zero
    faces, _t, frame, sigmoids, inverse_sum, blend = _gather_blend(i, inputs, around)
    axes, scale = jbs.disc_axes(load4(inputs.quaternion, 4 * i)), _exp(load2(inputs.log_scale, 2 * i))
    if has_eye:
        up_x, torque, view = backward.view_direction_gradient(
            blend[4], load3(centre, 3 * i), inputs.eye, inputs.rotate_directions, up_d, up_x
        )
    own = backward.skin_surfel_gradient(
        blend, frame, load3(inputs.position, 3 * i), axes, scale, (up_x, up_u, up_v)
    )  # fmt: skip
    return unchanged, (faces, sigmoids, inverse_sum, blend), own, (up_x, torque, view, up_d)


@simd_inline
def _store_gradients(i, inputs, upstream, gradients, unchanged, around_it, own, torque):
    faces, sigmoids, inverse_sum, blend = around_it
    dx, dq, ds, h, y = own
    zero, opacity = broadcast(np.float32(0)), jbs.sigmoid(load(inputs.logit, i))
    store3(gradients.position, 3 * i, _select(unchanged, zero, dx))
    store4(gradients.quaternion, 4 * i, _select(unchanged, zero, dq))
    store2(gradients.log_scale, 2 * i, _select(unchanged, zero, ds))
    logit = load(upstream.opacity, i) * opacity * (1 - opacity)
    store(gradients.logit, i, select(unchanged, zero, logit))
    db = (zero, zero, zero, zero)
    if inputs.blended:
        d_w, d_p = backward.motion_gradient(blend, h, y, torque)
        db = backward.blend_gradient(sigmoids, inverse_sum, d_w, d_p, faces)
    store4(gradients.blend, 4 * i, _select(unchanged, zero, db))


@simd_inline
def _store_motion_parts(i, inputs, parts, unchanged, blend, own, seen):
    (_dx, _dq, _ds, h, y), (up_x, torque, view, up_d) = own, seen
    v, w, _p, (a, b, _c), _q, _tangent = blend
    zero = broadcast(np.float32(0))
    dw, dp = backward.motion_gradient(blend, h, y, torque)
    rows, turned = backward.rotation_gradient(blend, h, y), (zero, zero, zero)
    if inputs.rotate_directions:
        turned = backward.turned_row(w, a, b, up_d)
    store4(parts.weights, 4 * i, _select(unchanged, zero, v))
    store3(parts.stretch_x, 3 * i, _select(unchanged, zero, (dp[0], dp[1], dp[2])))
    store3(parts.stretch_yz, 3 * i, _select(unchanged, zero, (dp[3], dp[4], dp[5])))
    store3(parts.centre, 3 * i, _select(unchanged, zero, up_x))
    store3(parts.rotation_x, 3 * i, _select(unchanged, zero, add(rows[0], multiply(view[0], turned))))
    store3(parts.rotation_y, 3 * i, _select(unchanged, zero, add(rows[1], multiply(view[1], turned))))
    store3(parts.rotation_z, 3 * i, _select(unchanged, zero, add(rows[2], multiply(view[2], turned))))
    store3(parts.turn, 3 * i, _select(unchanged, zero, dw))


@simd_inline
def _skin_backward(i, inputs, centre, upstream, gradients, around):
    align_stack()
    unchanged, around_it, own, seen = _surfel_gradient(i, inputs, centre, upstream, around)
    _store_gradients(i, inputs, upstream, gradients, unchanged, around_it, own, seen[1])


@simd_inline
def _skin_and_motion_backward(i, inputs, centre, upstream, gradients, parts, around):
    align_stack()
    unchanged, around_it, own, seen = _surfel_gradient(i, inputs, centre, upstream, around)
    _store_gradients(i, inputs, upstream, gradients, unchanged, around_it, own, seen[1])
    _store_motion_parts(i, inputs, parts, unchanged, around_it[3], own, seen)


@simd_inline_alloc
def _around():
    return (np.empty(3 * WIDTH, np.int32),)


@kernel
def skin(count, inputs, skinned):
    """Skin surfels as `skinning.skin_scalar`, on flat arrays.

    Args:
        count: Number of surfels, at least sixteen.
        inputs: `SkinningInputs` of flat float32 arrays.
        skinned: `SkinnedArrays` of flat arrays to write.
    """
    parallel_for_vectors(_skin, count, (inputs, skinned), _around)


@kernel
def skin_backward(count, inputs, centre, upstream, gradients):
    """Backward pass of `skin`, as `skinning.skin_scalar_backward`.

    Args:
        count: Number of surfels, at least sixteen.
        inputs: `SkinningInputs` of flat float32 arrays.
        centre: World centres that `skin` wrote, flat.
        upstream: `SkinnedArrays` of gradients, flat.
        gradients: `AttributeGradients` of flat arrays to write.
    """
    parallel_for_vectors(_skin_backward, count, (inputs, centre, upstream, gradients), _around)


@kernel
def skin_and_motion_backward(count, inputs, centre, upstream, gradients, parts):
    """`skin_backward`, and what each surfel adds to the gradients of the records, as `mesh_gradient.motion_parts`.

    Args:
        count: Number of surfels, at least sixteen.
        inputs: `SkinningInputs` of flat float32 arrays.
        centre: World centres that `skin` wrote, flat.
        upstream: `SkinnedArrays` of gradients, flat.
        gradients: `AttributeGradients` of flat arrays to write.
        parts: `MotionParts` of flat arrays to write.
    """
    parallel_for_vectors(_skin_and_motion_backward, count, (inputs, centre, upstream, gradients, parts), _around)
