"""Pinhole cameras with OpenCV axes; datasets on disk store OpenGL camera-to-world transforms."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])
"""From OpenGL camera axes (x right, y up, z backward) to OpenCV's (x right, y down, z forward); its own inverse."""


@dataclass(frozen=True, eq=False)
class Camera:
    """A pinhole camera; pixel centres lie at +0.5, lengths are in metres and pixels."""

    camera_from_world: Float[np.ndarray, "4 4"]
    """Rigid transform from world to OpenCV camera axes."""
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Camera):
            return NotImplemented
        # A generated comparison takes the truth value of an array, which is an error.
        numbers = ((*camera.intrinsics, camera.width, camera.height) for camera in (self, other))
        return next(numbers) == next(numbers) and np.array_equal(self.camera_from_world, other.camera_from_world)

    @property
    def intrinsics(self) -> tuple[float, float, float, float]:
        """Focal lengths fx, fy and principal point cx, cy in pixels, as Python floats for kernels."""
        return float(self.fx), float(self.fy), float(self.cx), float(self.cy)

    @property
    def world_from_camera(self) -> Float[np.ndarray, "4 4"]:
        """The inverse rigid transform."""
        rotation, translation = self.camera_from_world[:3, :3], self.camera_from_world[:3, 3]
        inverse = np.eye(4)
        inverse[:3, :3] = rotation.T
        inverse[:3, 3] = -rotation.T @ translation
        return inverse

    @property
    def centre(self) -> Float[np.ndarray, "3"]:
        """Position of the pinhole in the world."""
        return self.world_from_camera[:3, 3]

    def to_camera(self, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
        """Transform points from world to camera axes.

        Args:
            points: World points in metres.

        Returns:
            Points in camera axes in metres.
        """
        # Not `@`: for a tall and thin product, starting BLAS threads costs more than the product.
        return np.einsum("ij,kj->ik", points, self.camera_from_world[:3, :3]) + self.camera_from_world[:3, 3]

    def project(self, points: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
        """Project world points to the image.

        Args:
            points: World points in metres.

        Returns:
            Image positions (x, y) with pixel centres at +0.5, and depths in metres. Positions are valid where the depth
            is positive.
        """
        x, y, z = self.to_camera(points).T
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.stack([self.fx * x / z + self.cx, self.fy * y / z + self.cy], axis=1), z

    def scaled(self, factor: float) -> Camera:
        """Change the resolution.

        Args:
            factor: New resolution over the old one.

        Returns:
            The same view at that resolution.
        """
        intrinsics = (factor * length for length in self.intrinsics)
        return Camera(self.camera_from_world, *intrinsics, round(self.width * factor), round(self.height * factor))


def look_at(
    centre: Float[np.ndarray, "3"], target: Float[np.ndarray, "3"], up: Float[np.ndarray, "3"] | None = None
) -> Float[np.ndarray, "4 4"]:
    """Pose of a camera that looks at a point.

    Args:
        centre: Position of the camera in the world.
        target: Point on the optical axis.
        up: World direction that points up in the image; +y if None.

    Returns:
        `camera_from_world` in OpenCV axes.
    """
    up = np.array([0.0, 1.0, 0.0]) if up is None else up
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    camera_from_world = np.eye(4)
    camera_from_world[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    camera_from_world[:3, 3] = -camera_from_world[:3, :3] @ centre
    return camera_from_world
