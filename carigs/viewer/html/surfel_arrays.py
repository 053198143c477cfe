"""The surfels of an avatar for the page: attributes after their activations, rounded."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float64, Int

from carigs.splat.avatar import Avatar
from carigs.splat.colour.spherical_harmonics import SH_BASE
from carigs.splat.rig.jacobian_blend import MIN_LOGIT
from carigs.splat.surfels.surfels import to_arrays
from carigs.viewer.html.packed_arrays import PackedArray, pack_integers, pack_steps

POSITION_STEP = 1 / 512
"""Units of the triangle's scale: about 3 micrometres."""
ROTATION_STEP = 1 / 768
"""Of three components of a unit quaternion: at most 0.2 degrees."""
LOG_SCALE_STEP = 1 / 64
COLOUR_STEP = 1 / 512
"""Of RGB in [0, 1]."""
HARMONICS_STEP = 1 / 128
OPACITY_STEP = BLEND_STEP = 1 / 255
LARGEST = 1e6
"""Positions and colours beyond are cut off: whole numbers of 32 bits hold them."""


def surfel_arrays(avatar: Avatar) -> list[PackedArray]:
    """Pack the surfels.

    Args:
        avatar: The avatar.

    Returns:
        `surfels` of each triangle, and by surfel `position`, `largest` component of the quaternion and the three other
        ones as `rotation`, `log_scale`, `opacity`, `colour` of degree 0 as RGB, `harmonics` of higher degrees, and the
        weights `blend` of the three neighbours.
    """
    arrays = to_arrays(avatar.surfels)
    values = {name: np.nan_to_num(array.astype(np.float64)) for name, array in arrays.items() if name != "binding"}
    n = len(arrays["binding"])
    largest, others = smallest_three(values["rotation"])
    colour = (0.5 + SH_BASE * values["colour"]).clip(-LARGEST, LARGEST)
    return [
        pack_integers("surfels", np.bincount(arrays["binding"], minlength=len(avatar.sequence.head.faces))),
        pack_steps("position", values["position"].clip(-LARGEST, LARGEST), POSITION_STEP),
        pack_integers("largest", largest),
        pack_steps("rotation", others, ROTATION_STEP),
        pack_steps("log_scale", values["log_scale"].clip(-60, 60), LOG_SCALE_STEP),
        pack_steps("opacity", _sigmoid(values["opacity"]), OPACITY_STEP),
        pack_steps("colour", colour, COLOUR_STEP),
        pack_steps("harmonics", values["harmonics"].reshape(n, -1).clip(-LARGEST, LARGEST), HARMONICS_STEP),
        pack_steps("blend", _neighbour_weights(avatar, values["blend"]), BLEND_STEP),
    ]


def smallest_three(quaternions: Float[np.ndarray, "n 4"]) -> tuple[Int[np.ndarray, " n"], Float64[np.ndarray, "n 3"]]:
    """Leave out the component of unit quaternions that is largest without its sign, which is made positive.

    Args:
        quaternions: Of any length; the one without length becomes that of no rotation.

    Returns:
        Index of the component, and the three others in their order.
    """
    length = np.linalg.norm(quaternions, axis=1, keepdims=True)
    unit = np.where(length > 1e-30, quaternions / np.maximum(length, 1e-30), [1.0, 0.0, 0.0, 0.0])
    largest = np.abs(unit).argmax(axis=1)
    sign = np.where(np.take_along_axis(unit, largest[:, None], axis=1) < 0, -1, 1)
    kept = np.arange(4)[None] != largest[:, None]
    return largest, (sign * unit)[kept].reshape(-1, 3)


def _neighbour_weights(avatar: Avatar, logits: Float64[np.ndarray, "n 4"]) -> Float64[np.ndarray, "n 3"]:
    """Blend weights of the three neighbours; the rest is that of the own triangle."""
    if avatar.skinning != "jbs":
        return np.zeros((len(logits), 3))
    weights = _sigmoid(np.maximum(logits, MIN_LOGIT))
    return weights[:, 1:] / weights.sum(axis=1, keepdims=True)


def _sigmoid(x: Float64[np.ndarray, "*n"]) -> Float64[np.ndarray, "*n"]:
    return 0.5 + 0.5 * np.tanh(0.5 * x)
