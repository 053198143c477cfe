"""The derivative of the exponential map of rotations, for arrays of rotation vectors."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

SMALL_ANGLE = 1e-2
"""Radians below which (a - sin a) / a^3 is taken from its series, whose error is then below 1e-17."""


def left_jacobians(vectors: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3 3"]:
    """Derivative of the exponential map: exp(v + d) = exp(J d) exp(v) to first order in d.

    J = I + (1 - cos a)/a^2 K + (a - sin a)/a^3 K^2 with the angle a = |v| and the cross product matrix K of v
    (Chirikjian 2011, Stochastic Models, Information Theory, and Lie Groups, volume 2, section 10.6).

    Args:
        vectors: Rotation vectors v in radians.

    Returns:
        The matrices J.
    """
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*vectors.shape, 3)
    angle = np.linalg.norm(vectors, axis=-1)[..., None, None]
    small = angle < SMALL_ANGLE
    safe = np.where(small, 1, angle)
    series = 1 / 6 - angle**2 / 120 + angle**4 / 5040
    third = np.where(small, series, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * cross + third * (cross @ cross)
