"""Sizing field of the template mesh: short edges around eyes, mouth, nose and ears. Lengths are in millimetres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from carigs.toy.shape.anatomy import EYE_X, EYE_Z, SOCKET_RADIUS, eye_distance, lid_margins, lip_height, mouth_cavity


def target_edge_lengths(points: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, " v"]:
    """Target edge length at points of the surface.

    Args:
        points: Positions in meshing space (lips spread apart), in millimetres.

    Returns:
        Lengths in millimetres.
    """
    x, y, z = np.abs(points[:, 0]), points[:, 1], points[:, 2]
    length = np.full(len(points), 13.0)

    def near(fine: float, distance: np.ndarray, reach: float) -> None:
        """Set `fine` at a feature, with a linear transition to the previous length over `reach`."""
        np.minimum(length, fine + (length - fine) * np.clip(distance / reach, 0, 1), out=length)

    def box(centre: tuple[float, float, float], half: tuple[float, float, float]) -> np.ndarray:
        """Distance to a box."""
        beyond = np.maximum(np.abs(np.stack([x, y, z], axis=1) - centre) - half, 0)
        return np.linalg.norm(beyond, axis=1)

    near(7.0, np.sqrt((x / 62) ** 2 + ((y + 15) / 80) ** 2 + ((z - 80) / 55) ** 2) * 60 - 52, 40)  # face
    near(3.4, box((0, -8, 104), (17, 20, 16)), 18)  # nose
    near(1.9, box((7, -19, 104), (6, 4, 8)), 8)  # nostrils
    near(3.4, box((EYE_X, 29, 80), (17, 14, 10)), 14)  # lids
    lower, upper = lid_margins(x)
    margin = np.maximum(np.abs(np.maximum(y - upper, lower - y)) - 1.2, EYE_Z + 4 - z)
    near(1.6, np.maximum(margin, np.where((x < 15) | (x > 49), np.abs(x - EYE_X) - 16, 0)) - 0.5, 7)
    near(2.6, box((0, -44, 104), (25, 9, 14)), 20)  # lips
    near(1.9, np.max([np.abs(np.abs(y - lip_height(x)) - 3) - 2, 92 - z, x - 24], axis=0), 8)
    near(1.7, np.sqrt((x - 24.5) ** 2 + (y + 44) ** 2 + (z - 91) ** 2) - 3, 8)  # corner of the mouth
    near(4.0, box((82, 14, -16), (13, 34, 20)), 16)  # ear
    # Coarser where it is not visible: the back of the eye socket and the depth of the mouth cavity.
    hidden = np.where(eye_distance(points) < SOCKET_RADIUS + 0.6, np.clip(EYE_Z + 6 - z, 0, 6), 0)
    length = np.where(hidden > 0, np.maximum(length, 3.2 + 0.55 * hidden), length)
    hidden = np.where(mouth_cavity(points) < 1.25, np.clip(95 - z, 0, 9), 0)
    return np.where(hidden > 0, np.maximum(length, 2.4 + 0.55 * hidden), length)
