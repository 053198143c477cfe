"""Cameras that are estimated together with the head: focal lengths, and poses against the first camera."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from carigs.fitting.rotation_vectors import left_jacobians
from carigs.head.posing import rotation_matrices

POSE = 6
"""Parameters of a pose: rotation vector and translation of camera_from_world."""
LEAST_DEPTH = 1e-3
"""Metres: nearer points have no image."""


@dataclass(frozen=True)
class Cameras:
    """Pinhole cameras with square pixels. The first one stays where it is.

    Their free parameters are one vector: the logarithms of the focal lengths, each over its first value, then the
    poses of all cameras but the first, as changes of their first values.
    """

    focal: Float[np.ndarray, " c"]
    """First values in pixels."""
    centres: Float[np.ndarray, "c 2"]
    """Principal points in pixels."""
    poses: Float[np.ndarray, "c 6"]
    """First values of camera_from_world, in radians and metres; x to the right, y down, z forward."""

    @property
    def size(self) -> int:
        """Number of free parameters."""
        return len(self.focal) + POSE * (len(self.focal) - 1)

    def moved(self, parameters: Float[np.ndarray, " k"]) -> Cameras:
        """The cameras at other values of their parameters.

        Args:
            parameters: The free parameters.

        Returns:
            Cameras with these as first values.
        """
        c, poses = len(self.focal), self.poses.copy()
        poses[1:] += parameters[c:].reshape(-1, POSE)
        return replace(self, focal=self.focal * np.exp(parameters[:c]), poses=poses)

    def camera_from_world(self) -> Float[np.ndarray, "c 3 4"]:
        """Rotations and translations.

        Returns:
            Matrices, in metres.
        """
        return np.concatenate([rotation_matrices(self.poses[:, :3]), self.poses[:, 3:, None]], axis=2)

    def projections(self) -> Float[np.ndarray, "c 3 4"]:
        """Matrices P with P (X, 1) = depth (x, y, 1).

        Returns:
            Matrices, in pixels and metres.
        """
        matrices = self.camera_from_world()
        calibration = np.zeros((len(self.focal), 3, 3))
        calibration[:, [0, 1], [0, 1]] = self.focal[:, None]
        calibration[:, :2, 2], calibration[:, 2, 2] = self.centres, 1
        return calibration @ matrices

    def project(
        self, positions: Float[np.ndarray, "t n 3"]
    ) -> tuple[Float[np.ndarray, "t c n 2"], Float[np.ndarray, "t c n"]]:
        """Project points into all cameras.

        Args:
            positions: World points in metres.

        Returns:
            Image positions in pixels, and depths in metres. Points that are not in front of a camera have depth 0.
        """
        pixels, depth, _ = self._seen(positions)
        return pixels, depth

    def linearise(
        self, positions: Float[np.ndarray, "t n 3"]
    ) -> tuple[
        Float[np.ndarray, "t c n 2"],
        Float[np.ndarray, "t c n"],
        Float[np.ndarray, "t c n 2 3"],
        Float[np.ndarray, "t c n 2 k"],
    ]:
        """Project points and differentiate their images.

        Args:
            positions: World points in metres.

        Returns:
            Image positions, depths, and the derivatives of the image positions with respect to the world points and to
            the free parameters at 0.
        """
        pixels, depth, seen = self._seen(positions)
        c = len(self.focal)
        inverse = 1 / np.maximum(depth, LEAST_DEPTH)
        by_camera_point = np.zeros((*pixels.shape, 3))  # derivative with respect to the point in the camera's frame
        by_camera_point[..., [0, 1], [0, 1]] = (self.focal[:, None] * inverse)[..., None]
        by_camera_point[..., 2] = -(pixels - self.centres[:, None]) * inverse[..., None]
        by_point = by_camera_point @ self.camera_from_world()[:, None, :, :3]
        by_parameters = np.zeros((*pixels.shape, self.size))
        turned = seen - self.poses[:, None, 3:]
        jacobians = left_jacobians(self.poses[:, :3])
        for i in range(c):
            by_parameters[:, i, :, :, i] = pixels[:, i] - self.centres[i]
            if i:
                first = c + POSE * (i - 1)
                # The columns of -[turned] J.
                turn = np.cross(jacobians[i].T, turned[:, i, :, None, :]).swapaxes(-1, -2)
                by_parameters[:, i, :, :, first : first + 3] = by_camera_point[:, i] @ turn
                by_parameters[:, i, :, :, first + 3 : first + POSE] = by_camera_point[:, i]
        return pixels, depth, by_point, by_parameters

    def _seen(
        self, positions: Float[np.ndarray, "t n 3"]
    ) -> tuple[Float[np.ndarray, "t c n 2"], Float[np.ndarray, "t c n"], Float[np.ndarray, "t c n 3"]]:
        matrices = self.camera_from_world()
        seen = np.einsum("cij,tnj->tcni", matrices[..., :3], positions) + matrices[:, None, :, 3]
        depth = np.where(seen[..., 2] > LEAST_DEPTH, seen[..., 2], 0)
        ratio = seen[..., :2] / np.maximum(depth, LEAST_DEPTH)[..., None]
        return self.focal[:, None, None] * ratio + self.centres[:, None], depth, seen
