"""Argument groups of the skinning kernels, and how the scalar kernels read them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int32

from carigs.simd.tuples import read_row
from carigs.simd.vector_math import exp
from carigs.simd.vectors import scalar_or_simd
from carigs.splat.rig import jacobian_blend_backward as backward
from carigs.splat.rig.face_motion import CENTRE, RELATIVE_ROTATION, ROTATION, STRETCH
from carigs.splat.rig.jacobian_blend import blend_motion, blend_weights, disc_axes

KEPT = 9
"""Column of `Rig.frame_records` that says whether surfels of the triangle keep their size."""


class SkinningInputs(NamedTuple):
    """Inputs of Jacobian blend skinning; the scalar kernels take the arrays as they are, the vector kernels flat ones.

    Attributes:
        position: Centres in the frames of the triangles, in units of the triangles' scale.
        quaternion: wxyz, not normalised.
        log_scale: Logarithms of the standard deviations, in units of the triangles' scale.
        logit: Opacities before the sigmoid.
        blend: Logits of the blend weights: own triangle, then its neighbours.
        binding: Index of each surfel's triangle.
        frames: `Rig.frame_records`.
        neighbours: `Rig.neighbours`.
        records: `FaceMotion.records`.
        blended: Whether neighbours are blended; if not, the own triangle's Jacobian acts alone.
        eye: Centre of the camera in world coordinates.
        rotate_directions: Whether view directions are given in the axes of the canonical head.
    """

    position: Float[np.ndarray, "n 3"]
    quaternion: Float[np.ndarray, "n 4"]
    log_scale: Float[np.ndarray, "n 2"]
    logit: Float[np.ndarray, " n"]
    blend: Float[np.ndarray, "n 4"]
    binding: Int32[np.ndarray, " n"]
    frames: Float[np.ndarray, "f 16"]
    neighbours: Int32[np.ndarray, "f 3"]
    records: Float[np.ndarray, "f 32"]
    blended: bool
    eye: tuple[float, float, float]
    rotate_directions: bool


class SkinnedArrays(NamedTuple):
    """Surfels in world coordinates, or gradients with respect to them; `direction` is empty without a camera."""

    centre: Float[np.ndarray, "n 3"]
    tangent_u: Float[np.ndarray, "n 3"]
    tangent_v: Float[np.ndarray, "n 3"]
    opacity: Float[np.ndarray, " n"]
    direction: Float[np.ndarray, "n 3"]


class AttributeGradients(NamedTuple):
    """Gradients with respect to the surfels' attributes, as in `SkinningInputs`."""

    position: Float[np.ndarray, "n 3"]
    quaternion: Float[np.ndarray, "n 4"]
    log_scale: Float[np.ndarray, "n 2"]
    logit: Float[np.ndarray, " n"]
    blend: Float[np.ndarray, "n 4"]


class MotionParts(NamedTuple):
    """What each surfel adds to the gradients of its triangle's record and of its neighbours'.

    Attributes:
        weights: Blend weights: own triangle, then its neighbours.
        stretch_x: Gradient with respect to the numbers xx, xy, xz of the blended stretch.
        stretch_yz: The same for yy, yz, zz.
        centre: Gradient with respect to the centre of the own triangle.
        rotation_x: First row of the gradient with respect to the own triangle's rotation.
        rotation_y: Second row of it.
        rotation_z: Third row of it.
        turn: Gradient with respect to the blended rotation vector.
    """

    weights: Float[np.ndarray, "n 4"]
    stretch_x: Float[np.ndarray, "n 3"]
    stretch_yz: Float[np.ndarray, "n 3"]
    centre: Float[np.ndarray, "n 3"]
    rotation_x: Float[np.ndarray, "n 3"]
    rotation_y: Float[np.ndarray, "n 3"]
    rotation_z: Float[np.ndarray, "n 3"]
    turn: Float[np.ndarray, "n 3"]


read3, read4, read6, read9 = (read_row(count) for count in (3, 4, 6, 9))
"""Read 3, 4, 6 or 9 numbers of a row (array, row, first column or nothing)."""


@scalar_or_simd
def read_scale(i, inputs):
    """Read the standard deviations of surfel i.

    Args:
        i: Index of the surfel.
        inputs: `SkinningInputs`.

    Returns:
        Two numbers, in units of the triangle's scale.
    """
    return exp(inputs.log_scale[i, 0]), exp(inputs.log_scale[i, 1])


@scalar_or_simd
def read_blend(i, inputs):
    """Read the triangles around surfel i and blend their motions.

    Args:
        i: Index of the surfel.
        inputs: `SkinningInputs`.

    Returns:
        The stretches of the own triangle and its neighbours with the neighbours' relative rotations (`faces` in
        `jacobian_blend`), centre and canonical frame of the own triangle, sigmoids of the blend logits, the inverse of
        their sum, and the result of `jacobian_blend.blend_motion`.
    """
    f, records = inputs.binding[i], inputs.records
    j, k, m = read3(inputs.neighbours, f)
    faces = (
        read6(records, f, STRETCH), read6(records, j, STRETCH), read6(records, k, STRETCH), read6(records, m, STRETCH),
        read9(records, f, RELATIVE_ROTATION),
    )  # fmt: skip
    sigmoids, inverse_sum = (1.0, 0.0, 0.0, 0.0), 1.0
    if inputs.blended:
        sigmoids, inverse_sum = blend_weights(read4(inputs.blend, i))
    blend = blend_motion(sigmoids, inverse_sum, faces, read9(records, f, ROTATION), inputs.frames[f, KEPT])
    return faces, read3(records, f, CENTRE), read9(inputs.frames, f), sigmoids, inverse_sum, blend


@scalar_or_simd
def has_gradient(i, upstream):
    """Whether any gradient with respect to the skinned surfel i is not zero.

    Args:
        i: Index of the surfel.
        upstream: `SkinnedArrays` of gradients.

    Returns:
        Truth value.
    """
    moved = upstream.opacity[i] != 0
    for c in range(3):
        moved |= upstream.centre[i, c] != 0 or upstream.tangent_u[i, c] != 0 or upstream.tangent_v[i, c] != 0
        moved |= len(upstream.direction) > 0 and upstream.direction[i, c] != 0
    return moved


@scalar_or_simd
def surfel_gradient(i, inputs, centre, upstream, frame, blend):
    """Backward pass of skinning for the attributes of surfel i.

    Args:
        i: Index of the surfel.
        inputs: `SkinningInputs`.
        centre: World centres that skinning wrote.
        upstream: `SkinnedArrays` of gradients with respect to what skinning wrote.
        frame: Canonical frame of the own triangle, from `read_blend`.
        blend: Blended motion, from `read_blend`.

    Returns:
        Results of `jacobian_blend_backward.skin_surfel_gradient`; and those of `view_direction_gradient`: the whole
        gradient with respect to the centre, the gradient with respect to dw, and the unit vector from the eye.
    """
    g_centre, torque, view = read3(upstream.centre, i), (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    if len(upstream.direction) > 0:
        g_centre, torque, view = backward.view_direction_gradient(
            blend[4], read3(centre, i), inputs.eye, inputs.rotate_directions, read3(upstream.direction, i), g_centre
        )
    gradients = (g_centre, read3(upstream.tangent_u, i), read3(upstream.tangent_v, i))
    axes = disc_axes(read4(inputs.quaternion, i))
    own = backward.skin_surfel_gradient(
        blend, frame, read3(inputs.position, i), axes, read_scale(i, inputs), gradients
    )  # fmt: skip
    return own, (g_centre, torque, view)
