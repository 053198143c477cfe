"""Camera trajectories around the point that the cameras of a capture look at."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from carigs.capture.camera import Camera, look_at
from carigs.capture.dataset import Capture


def orbit_cameras(capture: Capture, count: int, degrees: float) -> list[Camera]:
    """Cameras on a horizontal arc around the point that the training cameras look at.

    Height, distance, intrinsics and the middle of the arc are the means of the training cameras.

    Args:
        capture: The capture; all its cameras are used if none belongs to a training frame.
        count: Number of cameras.
        degrees: Angle of the arc about the vertical axis.

    Returns:
        The cameras, from one end of the arc to the other.
    """
    used = sorted({frame.camera for frame in capture.split("train")}) or sorted(capture.cameras)
    cameras = [capture.cameras[c] for c in used]
    target = nearest_point_to_axes(cameras)
    offsets = np.array([camera.centre for camera in cameras]) - target
    radii = np.linalg.norm(offsets[:, [0, 2]], axis=1)
    direction = (offsets[:, [0, 2]] / radii[:, None]).mean(axis=0)
    azimuths = np.arctan2(*direction) + np.radians(degrees) * np.linspace(-0.5, 0.5, count)
    width, height = round(np.mean([c.width for c in cameras])), round(np.mean([c.height for c in cameras]))
    intrinsics = np.mean([camera.intrinsics for camera in cameras], axis=0).tolist()
    x, z, y = radii.mean() * np.sin(azimuths), radii.mean() * np.cos(azimuths), np.full(count, offsets[:, 1].mean())
    centres = target + np.stack([x, y, z], axis=1)
    return [Camera(look_at(centre, target), *intrinsics, width, height) for centre in centres]


def nearest_point_to_axes(cameras: list[Camera]) -> Float[np.ndarray, "3"]:
    """The point nearest to all optical axes (least squares).

    Args:
        cameras: One camera or more.

    Returns:
        The point in world axes; for parallel axes, the mean of the points 1 m in front of the cameras.
    """
    axes = np.array([camera.camera_from_world[2, :3] for camera in cameras])
    centres = np.array([camera.centre for camera in cameras])
    projections = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    matrix = projections.sum(axis=0)
    if np.linalg.cond(matrix) > 1e6:
        return (centres + axes).mean(axis=0)
    return np.linalg.solve(matrix, np.einsum("nij,nj->i", projections, centres))
