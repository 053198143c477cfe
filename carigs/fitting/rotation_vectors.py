"""The exponential map of rotations and its derivative, for arrays of rotation vectors."""

from __future__ import annotations

import numpy as np
from jaxtyping import Inexact

SMALL_ANGLE = 1e-2
"""Radians below which (a - sin a) / a^3 is taken from its series, whose error is then below 1e-17."""


def cross_matrices(vectors: Inexact[np.ndarray, "*n 3"]) -> Inexact[np.ndarray, "*n 3 3"]:
    """Matrices K of the cross product, K x = v × x.

    Args:
        vectors: The vectors v.

    Returns:
        Skew-symmetric matrices.
    """
    x, y, z = np.moveaxis(vectors, -1, 0)
    zero = np.zeros_like(x)
    entries = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    return entries.reshape(*vectors.shape, 3)


def rotation_matrices(vectors: Inexact[np.ndarray, "*n 3"]) -> Inexact[np.ndarray, "*n 3 3"]:
    """Rodrigues' formula R = I + sin(a)/a K + (1 - cos a)/a^2 K^2 with the angle a = |v|.

    Args:
        vectors: Axis times angle, in radians. Complex vectors give the analytic continuation.

    Returns:
        Rotation matrices.
    """
    cross, angle = cross_matrices(vectors), _angles(vectors)
    return np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * (cross @ cross)


def left_jacobians(vectors: Inexact[np.ndarray, "*n 3"]) -> Inexact[np.ndarray, "*n 3 3"]:
    """Derivative of the exponential map: exp(v + d) = exp(J d) exp(v) to first order in d.

    J = I + (1 - cos a)/a^2 K + (a - sin a)/a^3 K^2 (Chirikjian 2011, Stochastic Models, Information Theory, and Lie
    Groups, volume 2, section 10.6).

    Args:
        vectors: Rotation vectors v in radians.

    Returns:
        The matrices J.
    """
    cross, angle = cross_matrices(vectors), _angles(vectors)
    small = np.abs(angle) < SMALL_ANGLE
    safe = np.where(small, 1, angle)
    series = 1 / 6 - angle**2 / 120 + angle**4 / 5040
    third = np.where(small, series, (safe - np.sin(safe)) / safe**3)
    return np.eye(3) + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * cross + third * (cross @ cross)


def _angles(vectors: Inexact[np.ndarray, "*n 3"]) -> Inexact[np.ndarray, "*n 1 1"]:
    return np.sqrt((vectors**2).sum(axis=-1))[..., None, None]
