"""Pinhole cameras: OpenCV axes in memory, OpenGL camera-to-world on disk."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

# Camera axes: OpenCV (x right, y down, z forward) <-> OpenGL (x right, y up, z backward).  Its own inverse.
OPENCV_FROM_OPENGL = np.diag([1.0, -1.0, -1.0, 1.0])


@dataclass(frozen=True)
class Camera:
    """A pinhole camera; pixel centres lie at +0.5, lengths are in metres and pixels."""

    camera_from_world: Float[np.ndarray, "4 4"]
    """Rigid transform of world points into OpenCV camera axes."""
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int

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
        """World points in camera axes."""
        # Not `@`: for a tall and thin product, starting BLAS threads costs more than the product.
        return np.einsum("ij,kj->ik", points, self.camera_from_world[:3, :3]) + self.camera_from_world[:3, 3]

    def project(self, points: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"]]:
        """Pixel positions and depths of world points; points with depth <= 0 have no meaningful pixel."""
        x, y, z = self.to_camera(points).T
        with np.errstate(divide="ignore", invalid="ignore"):
            return np.stack([self.fx * x / z + self.cx, self.fy * y / z + self.cy], axis=1), z

    def scaled(self, factor: float) -> Camera:
        """The same view at `factor` times the resolution (for supersampling, or for smaller images)."""
        return replace(
            self,
            fx=self.fx * factor,
            fy=self.fy * factor,
            cx=self.cx * factor,
            cy=self.cy * factor,
            width=round(self.width * factor),
            height=round(self.height * factor),
        )


def look_at(
    centre: Float[np.ndarray, "3"], target: Float[np.ndarray, "3"], up: Float[np.ndarray, "3"] | None = None
) -> Float[np.ndarray, "4 4"]:
    """`camera_from_world` of a camera at `centre` that looks at `target`, image upright along `up` (default +y)."""
    up = np.array([0.0, 1.0, 0.0]) if up is None else up
    forward = (target - centre) / np.linalg.norm(target - centre)
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    camera_from_world = np.eye(4)
    camera_from_world[:3, :3] = np.stack([right, np.cross(forward, right), forward])
    camera_from_world[:3, 3] = -camera_from_world[:3, :3] @ centre
    return camera_from_world
