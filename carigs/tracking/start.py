"""A first guess for tracking: the template's pose before each camera, by its landmarks alone."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.errors import CarigsError
from carigs.fitting.head_points import HeadPoints
from carigs.tracking.camera_placement import place_cameras, rotation_vectors
from carigs.tracking.cameras import Cameras

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


def first_guess(
    points: HeadPoints,
    pixels: Float[np.ndarray, "t c n 2"],
    seen: Bool[np.ndarray, "t c n"],
    cameras: Cameras,
) -> tuple[Float[np.ndarray, "t q"], Cameras, Int[np.ndarray, " m"]]:
    """Place the template before all cameras, and the cameras by it.

    Args:
        points: The landmarks on the template.
        pixels: The landmarks in the images.
        seen: Which of them there are.
        cameras: Focal lengths, and the pose of the first camera, which it keeps.

    Returns:
        Parameters of each frame, those without a pose with that of the nearest with one; the cameras; and the frames
        with a pose.

    Raises:
        CarigsError: If the landmarks place the template in no frame, or not before a camera and another one at once.
    """
    lenses = zip(cameras.focal, cameras.centres, strict=True)
    poses = [template_poses(points.template_points, pixels[:, c], seen[:, c], *lens) for c, lens in enumerate(lenses)]
    placed, heads = place_cameras(np.stack(poses, axis=1))
    found = np.flatnonzero(np.isfinite(heads[:, 0, 0]))
    if not found.size:
        raise CarigsError("in no frame can the head model be placed by its landmarks; see their places on it")
    if not np.isfinite(placed).all():
        lost = np.flatnonzero(np.isnan(placed[:, 0, 0]))[0]
        raise CarigsError(f"camera {lost} from 0: in no frame can it and another camera place the head model at once")
    first = np.eye(4)
    first[:3] = cameras.camera_from_world()[0]
    placed, heads = placed @ first, np.linalg.inv(first) @ heads[found]
    frames = np.zeros((len(seen), points.fitted.frame_size))
    root = points.joints[0]  # the model turns about its root joint
    known = np.hstack([heads[:, :3, :3] @ root + heads[:, :3, 3] - root, rotation_vectors(heads[:, :3, :3])])
    frames[:, :6] = known[np.abs(np.arange(len(seen))[:, None] - found).argmin(axis=1)]
    others = np.hstack([rotation_vectors(placed[:, :3, :3]), placed[:, :3, 3]])[1:]
    return frames, replace(cameras, poses=np.vstack([cameras.poses[:1], others])), found
