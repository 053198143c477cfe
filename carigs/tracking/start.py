"""A first guess for tracking: the template's pose before each camera, by its landmarks alone."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float

LEAST_POINTS = 6
"""Landmarks that a template is placed by."""


def template_poses(
    template: Float[np.ndarray, "n 3"],
    pixels: Float[np.ndarray, "t n 2"],
    seen: Bool[np.ndarray, "t n"],
    focal: float,
    centre: Float[np.ndarray, "2"],
) -> Float[np.ndarray, "t 4 4"]:
    """Place the template in the images of one camera (perspective-n-point, refined by Levenberg-Marquardt).

    Args:
        template: The landmarks on the template in metres.
        pixels: The landmarks in the images.
        seen: Which of them there are.
        focal: Focal length in pixels.
        centre: Principal point in pixels.

    Returns:
        camera_from_head for each frame; NaN where fewer than six landmarks are seen or no pose is found.
    """
    matrix = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1.0]])
    poses = np.full((len(pixels), 4, 4), np.nan)
    for pose, image, known in zip(poses, pixels, seen, strict=True):
        if known.sum() < LEAST_POINTS:
            continue
        found, turn, shift = cv2.solvePnP(template[known], image[known], matrix, None, flags=cv2.SOLVEPNP_SQPNP)
        if not found or not (template[known] @ cv2.Rodrigues(turn)[0][2] + shift[2, 0] > 0).all():
            continue
        turn, shift = cv2.solvePnPRefineLM(template[known], image[known], matrix, None, turn, shift)
        pose[:] = np.eye(4)
        pose[:3, :3], pose[:3, 3] = cv2.Rodrigues(turn)[0], shift[:, 0]
    return poses
