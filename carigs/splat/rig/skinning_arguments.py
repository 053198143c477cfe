"""Argument groups of the skinning kernels, and how the scalar kernels read them."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Int32

from carigs.simd.vectors import scalar_or_simd
from carigs.splat.rig.face_motion import CENTRE, RELATIVE_ROTATION, ROTATION, STRETCH
from carigs.splat.rig.jacobian_blend import blend_motion, blend_weights


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
    logit: Float[np.ndarray, "n"]
    blend: Float[np.ndarray, "n 4"]
    binding: Int32[np.ndarray, "n"]
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
    opacity: Float[np.ndarray, "n"]
    direction: Float[np.ndarray, "n 3"]


class AttributeGradients(NamedTuple):
    """Gradients with respect to the surfels' attributes, as in `SkinningInputs`."""

    position: Float[np.ndarray, "n 3"]
    quaternion: Float[np.ndarray, "n 4"]
    log_scale: Float[np.ndarray, "n 2"]
    logit: Float[np.ndarray, "n"]
    blend: Float[np.ndarray, "n 4"]


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
        _read_stretch(records, f), _read_stretch(records, j), _read_stretch(records, k), _read_stretch(records, m),
        read9(records, f, RELATIVE_ROTATION),
    )  # fmt: skip
    sigmoids, inverse_sum = (1.0, 0.0, 0.0, 0.0), 1.0
    if inputs.blended:
        sigmoids, inverse_sum = blend_weights(read4(inputs.blend, i))
    blend = blend_motion(sigmoids, inverse_sum, faces, read9(records, f, ROTATION))
    centre = (records[f, CENTRE], records[f, CENTRE + 1], records[f, CENTRE + 2])
    return faces, centre, read9(inputs.frames, f, 0), sigmoids, inverse_sum, blend


@scalar_or_simd
def read3(rows, i):
    """Read the first three numbers of a row.

    Args:
        rows: Array (n, 3 or more).
        i: Index of the row.

    Returns:
        A tuple.
    """
    return rows[i, 0], rows[i, 1], rows[i, 2]


@scalar_or_simd
def read4(rows, i):
    """Read the first four numbers of a row.

    Args:
        rows: Array (n, 4 or more).
        i: Index of the row.

    Returns:
        A tuple.
    """
    return rows[i, 0], rows[i, 1], rows[i, 2], rows[i, 3]


@scalar_or_simd
def _read_stretch(records, f):
    r = records[f, STRETCH : STRETCH + 6]
    return r[0], r[1], r[2], r[3], r[4], r[5]


@scalar_or_simd
def read9(rows, i, column):
    """Read nine numbers of a row.

    Args:
        rows: Array (n, k).
        i: Index of the row.
        column: First column.

    Returns:
        A tuple.
    """
    r = rows[i, column : column + 9]
    return r[0], r[1], r[2], r[3], r[4], r[5], r[6], r[7], r[8]
