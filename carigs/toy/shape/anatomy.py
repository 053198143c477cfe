"""Dimensions and feature curves of the head: eyes, lids, mouth. All lengths and coordinates are in millimetres.

The curves can be called with arrays and in Numba kernels.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float
from numba.extending import register_jitable

EYE_X, EYE_Y, EYE_Z, EYE_RADIUS = 31.8, 28.0, 69.0, 12.3  # the left eyeball
EYE_CENTRE = np.array([EYE_X, EYE_Y, EYE_Z])
SOCKET_RADIUS = 12.75
CANTHUS_INNER, CANTHUS_OUTER = 18.0, 46.0  # x of the corners of the eye
MOUTH_CORNER = 24.5  # x of the corner of the mouth


@register_jitable
def lid_margins(x):
    """Heights of the lid margins; they cross at the corners of the eye.

    Args:
        x: Lateral coordinate in millimetres, a number or an array; the sign does not matter.

    Returns:
        y of the lower and of the upper lid margin, in millimetres.
    """
    t = (abs(x) - CANTHUS_INNER) / (CANTHUS_OUTER - CANTHUS_INNER)
    line = 25.9 + 2.6 * t
    upper = 4.0 * t * (1.0 - t) * (1.0 - 0.22 * (2.0 * t - 1.0))
    lower = 4.0 * t * (1.0 - t) * (1.0 + 0.25 * (2.0 * t - 1.0))
    return line - 4.2 * lower, line + 5.9 * upper


@register_jitable
def lip_height(x):
    """Height of the line where the closed lips meet.

    Args:
        x: Lateral coordinate in millimetres, a number or an array; the sign does not matter.

    Returns:
        y in millimetres.
    """
    t = abs(x) / MOUTH_CORNER
    return -43.4 - 0.9 * np.exp(-((t / 0.16) ** 2)) + 0.5 * np.exp(-(((t - 0.35) / 0.25) ** 2)) - 0.6 * t**4


def eye_distance(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Distance to the centre of the eyeball on the same side of the head.

    Args:
        points: Positions, in millimetres.

    Returns:
        Distances in millimetres.
    """
    x, y, z = points.T
    return np.sqrt((np.abs(x) - EYE_X) ** 2 + (y - EYE_Y) ** 2 + (z - EYE_Z) ** 2)


def mouth_cavity(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Quadratic form of the ellipsoid that bounds the mouth cavity.

    Args:
        points: Positions, in millimetres.

    Returns:
        1 on the ellipsoid, less inside.
    """
    x, y, z = points.T
    return (x / 26) ** 2 + ((y + 44) / 14) ** 2 + ((z - 78) / 21) ** 2
