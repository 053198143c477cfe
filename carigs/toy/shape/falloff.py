"""Smooth weights on points: what the bases, regions and skin weights are made of.  Millimetres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float


def smoothstep(t: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """0 below 0, 1 above 1, with flat ends."""
    t = np.clip(t, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def bump(
    points: Float[np.ndarray, "n 3"], centre: tuple[float, float, float], radii: tuple[float, float, float]
) -> Float[np.ndarray, "n"]:
    """A Gaussian of height 1 and the same one mirrored: symmetric in x."""
    square = ((np.abs(points[:, 0]) - centre[0]) / radii[0]) ** 2
    square += ((points[:, 1] - centre[1]) / radii[1]) ** 2
    square += ((points[:, 2] - centre[2]) / radii[2]) ** 2
    return np.exp(-square)


def sideways(points: Float[np.ndarray, "n 3"], width: float = 4.0) -> Float[np.ndarray, "n"]:
    """-1 on the right, +1 on the left, odd, with a smooth passage at the midline."""
    return np.tanh(points[:, 0] / width)


def left_half(points: Float[np.ndarray, "n 3"], width: float = 6.0) -> Float[np.ndarray, "n"]:
    """1 on the left, 0 on the right; with its mirror image it adds up to 1."""
    return 0.5 + 0.5 * sideways(points, width)


def rotated(
    points: Float[np.ndarray, "n 3"],
    centre: Float[np.ndarray, "3"],
    axis: int,
    angle: Float[np.ndarray, "n"] | float,
) -> Float[np.ndarray, "n 3"]:
    """Points turned about a coordinate axis through `centre`, each by its own angle (radians)."""
    i, j = (axis + 1) % 3, (axis + 2) % 3
    cos, sin = np.cos(angle), np.sin(angle)
    local = points - centre
    turned = local.copy()
    turned[:, i] = cos * local[:, i] - sin * local[:, j]
    turned[:, j] = sin * local[:, i] + cos * local[:, j]
    return turned + centre
