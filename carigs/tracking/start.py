"""A first guess for tracking: the template's pose in each image of a camera, from its landmarks alone."""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial.transform import Rotation

from carigs.tracking.cameras import Cameras

LEAST_POINTS = 6
"""Landmarks that a template is placed by."""


def template_poses(
    template: Float[np.ndarray, "n 3"],
    root: Float[np.ndarray, "3"],
    pixels: Float[np.ndarray, "t n 2"],
    seen: Bool[np.ndarray, "t n"],
    cameras: Cameras,
    camera: int = 0,
) -> Float[np.ndarray, "t 6"]:
    """Place the template in the images of one camera (perspective-n-point, refined by Levenberg-Marquardt).

    Args:
        template: The landmarks on the template in metres.
        root: The root joint, about which the head turns.
        pixels: The landmarks in the images.
        seen: Which of them there are.
        cameras: The cameras.
        camera: The camera that sees them.

    Returns:
        Translation and rotation vector of the head in the world, for each frame; NaN where fewer than six landmarks are
        seen or no pose is found.
    """
    matrix = np.array([[cameras.focal[camera], 0, cameras.centres[camera, 0]],
                       [0, cameras.focal[camera], cameras.centres[camera, 1]], [0, 0, 1.0]])  # fmt: skip
    camera_from_world = cameras.camera_from_world()[camera]
    poses = np.full((len(pixels), 6), np.nan)
    for pose, image, known in zip(poses, pixels, seen, strict=True):
        if known.sum() < LEAST_POINTS:
            continue
        found, turn, shift = cv2.solvePnP(template[known], image[known], matrix, None, flags=cv2.SOLVEPNP_SQPNP)
        if not found or not (template[known] @ cv2.Rodrigues(turn)[0][2] + shift[2, 0] > 0).all():
            continue
        turn, shift = cv2.solvePnPRefineLM(template[known], image[known], matrix, None, turn, shift)
        rotation = camera_from_world[:, :3].T @ cv2.Rodrigues(turn)[0]
        translation = camera_from_world[:, :3].T @ (shift[:, 0] - camera_from_world[:, 3])
        pose[:3] = translation + rotation @ root - root  # the model turns about its root joint
        pose[3:] = Rotation.from_matrix(rotation).as_rotvec()
    return poses
