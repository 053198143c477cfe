"""Cameras that are estimated together with the head: focal lengths, and poses against the first camera."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from carigs.capture import Camera
from carigs.fitting.rotation_vectors import left_jacobians
from carigs.head.posing import rotation_matrices

POSE = 6
"""Parameters of a pose: rotation vector and translation of camera_from_world."""
LEAST_DEPTH = 1e-3
"""Metres: nearer points have no image."""


@dataclass(frozen=True)
class Cameras:
    """Pinhole cameras with square pixels. The first one stays where it is.

    Their free parameters are one vector: the logarithms of the focal lengths of all lenses, each over its first value,
    then the poses of all cameras but the first, as changes of their first values. Each camera depends on few of them,
    so that a hundred cameras cost a hundred times as much as one, and not ten thousand times.
    """

    focal: Float[np.ndarray, " c"]
    """First values in pixels."""
    centres: Float[np.ndarray, "c 2"]
    """Principal points in pixels."""
    poses: Float[np.ndarray, "c 6"]
    """First values of camera_from_world, in radians and metres; x to the right, y down, z forward."""
    lenses: Int[np.ndarray, " c"] | None = None
    """Number of each camera's lens, from 0: cameras with one lens share the focal length. None: each has its own."""

    @property
    def lens(self) -> Int[np.ndarray, " c"]:
        """Number of each camera's lens."""
        return np.arange(len(self.focal)) if self.lenses is None else self.lenses

    @property
    def lens_count(self) -> int:
        """Number of focal lengths that are estimated."""
        return int(self.lens.max()) + 1

    @property
    def size(self) -> int:
        """Number of free parameters."""
        return self.lens_count + POSE * (len(self.focal) - 1)

    def own_parameters(self, camera: int) -> Int[np.ndarray, " m"]:
        """The free parameters that a camera depends on.

        Args:
            camera: The camera.

        Returns:
            Their places in the vector: that of the focal length, and for all cameras but the first the six of the pose.
        """
        first = self.lens_count + POSE * (camera - 1)
        return np.append(self.lens[camera], np.arange(first, first + POSE) if camera else np.zeros(0, int))

    def moved(self, parameters: Float[np.ndarray, " k"]) -> Cameras:
        """The cameras at other values of their parameters.

        Args:
            parameters: The free parameters.

        Returns:
            Cameras with these as first values.
        """
        count, poses = self.lens_count, self.poses.copy()
        poses[1:] += parameters[count:].reshape(-1, POSE)
        return replace(self, focal=self.focal * np.exp(parameters[:count])[self.lens], poses=poses)

    def camera_from_world(self) -> Float[np.ndarray, "c 3 4"]:
        """Rotations and translations.

        Returns:
            Matrices, in metres.
        """
        return np.concatenate([rotation_matrices(self.poses[:, :3]), self.poses[:, 3:, None]], axis=2)

    def pinholes(self, sizes: Sequence[tuple[int, int]]) -> tuple[Camera, ...]:
        """The cameras as they are at the first values.

        Args:
            sizes: Width and height of the images of each.

        Returns:
            One for each.
        """
        poses = np.tile(np.eye(4), (len(self.focal), 1, 1))
        poses[:, :3] = self.camera_from_world()
        lenses = zip(poses, self.focal, self.centres, sizes, strict=True)
        return tuple(Camera(pose, float(f), float(f), float(x), float(y), *size) for pose, f, (x, y), size in lenses)

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
        Float[np.ndarray, "t c n 2 7"],
    ]:
        """Project points and differentiate their images.

        Args:
            positions: World points in metres.

        Returns:
            Image positions, depths, and the derivatives of the image positions with respect to the world points and to
            the camera's own free parameters at 0: the focal length and the pose, which the first camera keeps.
        """
        pixels, depth, seen = self._seen(positions)
        inverse = 1 / np.maximum(depth, LEAST_DEPTH)
        by_camera_point = np.zeros((*pixels.shape, 3))  # derivative with respect to the point in the camera's frame
        by_camera_point[..., [0, 1], [0, 1]] = (self.focal[:, None] * inverse)[..., None]
        by_camera_point[..., 2] = -(pixels - self.centres[:, None]) * inverse[..., None]
        by_point = by_camera_point @ self.camera_from_world()[:, None, :, :3]
        by_own = np.empty((*pixels.shape, 1 + POSE))
        by_own[..., 0] = pixels - self.centres[:, None]
        # The columns of -[turned] J, then those of the translation.
        turned, jacobians = seen - self.poses[:, None, 3:], left_jacobians(self.poses[:, :3])
        turn = np.cross(jacobians.swapaxes(1, 2)[:, None], turned[:, :, :, None]).swapaxes(-1, -2)
        by_own[..., 1:4], by_own[..., 4:] = by_camera_point @ turn, by_camera_point
        return pixels, depth, by_point, by_own

    def _seen(
        self, positions: Float[np.ndarray, "t n 3"]
    ) -> tuple[Float[np.ndarray, "t c n 2"], Float[np.ndarray, "t c n"], Float[np.ndarray, "t c n 3"]]:
        matrices = self.camera_from_world()
        seen = np.einsum("cij,tnj->tcni", matrices[..., :3], positions) + matrices[:, None, :, 3]
        depth = np.where(seen[..., 2] > LEAST_DEPTH, seen[..., 2], 0)
        ratio = seen[..., :2] / np.maximum(depth, LEAST_DEPTH)[..., None]
        return self.focal[:, None, None] * ratio + self.centres[:, None], depth, seen
