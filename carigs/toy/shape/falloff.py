"""Falloff weights and displacement fields on points: the building blocks of blendshapes, regions and texture.

Positions and displacements are in millimetres; x points to the subject's left, y up, z forward.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

Triple = tuple[float, float, float]


def gaussian(points: Float[np.ndarray, "n 3"], centre: Triple, radii: Triple) -> Float[np.ndarray, " n"]:
    """Gaussian falloff exp(-d^2) around a point and around its mirror image, symmetric in x.

    Args:
        points: Positions, in millimetres.
        centre: Centre of the Gaussian, x >= 0.
        radii: Distance along each axis at which the weight is 1/e.

    Returns:
        Weights in [0, 1].
    """
    square = ((np.abs(points[:, 0]) - centre[0]) / radii[0]) ** 2
    square += ((points[:, 1] - centre[1]) / radii[1]) ** 2
    square += ((points[:, 2] - centre[2]) / radii[2]) ** 2
    return np.exp(-square)


def smooth_sign(points: Float[np.ndarray, "n 3"], width: float = 4.0) -> Float[np.ndarray, " n"]:
    """Smooth sign of x: +1 on the subject's left, -1 on the right.

    Args:
        points: Positions, in millimetres.
        width: Width of the transition at the midline, in millimetres.

    Returns:
        Values in (-1, 1).
    """
    return np.tanh(points[:, 0] / width)


def displacement_field(
    points: Float[np.ndarray, "n 3"],
    lateral: Float[np.ndarray, " n"] | float,
    up: Float[np.ndarray, " n"] | float,
    forward: Float[np.ndarray, " n"] | float,
) -> Float[np.ndarray, "n 3"]:
    """Stack the components of a displacement field, each an array or a constant.

    Args:
        points: Positions; only their number matters.
        lateral: Component along x, in millimetres.
        up: Component along y.
        forward: Component along z.

    Returns:
        Displacements, in millimetres.
    """
    zeros = np.zeros(len(points))
    return np.stack([lateral + zeros, up + zeros, forward + zeros], axis=1)


def gaussian_displacement(
    points: Float[np.ndarray, "n 3"], step: Triple, centre: Triple, radii: Triple, *, mirrored: bool = True
) -> Float[np.ndarray, "n 3"]:
    """Displacement by one vector with Gaussian falloff around a point and its mirror image.

    Args:
        points: Positions, in millimetres.
        step: Displacement at the centre, in millimetres.
        centre: Centre of the Gaussian, x >= 0.
        radii: Distance along each axis at which the displacement has fallen to 1/e.
        mirrored: Whether the x component changes sign at the midline, which makes the field symmetric.

    Returns:
        Displacements, in millimetres.
    """
    side = smooth_sign(points) if mirrored else 1.0
    return displacement_field(points, step[0] * side, step[1], step[2]) * gaussian(points, centre, radii)[:, None]


def rotated(
    points: Float[np.ndarray, "n 3"], centre: Float[np.ndarray, "3"], axis: int, angle: Float[np.ndarray, " n"] | float
) -> Float[np.ndarray, "n 3"]:
    """Rotate points about a coordinate axis through `centre`, each by its own angle.

    Args:
        points: Positions, in millimetres.
        centre: A point on the axis of rotation.
        axis: 0, 1 or 2 for x, y or z.
        angle: Radians, one for all points or one for each.

    Returns:
        Rotated positions.
    """
    i, j = (axis + 1) % 3, (axis + 2) % 3
    cos, sin = np.cos(angle), np.sin(angle)
    local = points - centre
    turned = local.copy()
    turned[:, i] = cos * local[:, i] - sin * local[:, j]
    turned[:, j] = sin * local[:, i] + cos * local[:, j]
    return turned + centre
