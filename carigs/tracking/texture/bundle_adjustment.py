"""Bundle adjustment of one rigid body before one camera that stands still.

The unknowns are the poses of all frames and the places of all points on the body. Points are eliminated (Schur
complement; Triggs et al. 2000). A point is seen in frames that follow each other, so that what remains couples
neighbouring frames, and its matrix has a band.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import solveh_banded
from scipy.sparse import bsr_array, csr_array

from carigs.head.joint_transforms import rotation_matrices
from carigs.tracking.texture.corners import TextureTracks

SIGMA, OUTLIER = 0.5, 4.0
"""Standard deviation of a track in pixels, and the scale of the loss (Geman and McClure) in standard deviations."""
TURN, SHIFT, DEPTH = 0.1, 0.01, 0.03
"""Standard deviations of the poses about the first guess, in radians and metres: what holds the whole where it is."""
PLACE = 0.02
"""Standard deviation in metres of the points about the first guess."""
STEPS, TOLERANCE = 30, 1e-4
DAMPING, LARGEST_DAMPING = 1e-4, 1e6


@dataclass(frozen=True)
class RigidMotion:
    """Poses of a body, and points on it."""

    rotation: Float[np.ndarray, "t 3 3"]
    """camera_from_body."""
    middle: Float[np.ndarray, "t 3"]
    """Where the body's origin is, in the camera's axes, in metres."""
    points: Float[np.ndarray, "n 3"]
    """On the body."""

    def seen(self, tracks: TextureTracks) -> Float[np.ndarray, "k 3"]:
        """The points of tracks, in the camera's axes.

        Args:
            tracks: The tracks.

        Returns:
            Points in metres.
        """
        turned = np.einsum("kij,kj->ki", self.rotation[tracks.frame], self.points[tracks.corner])
        return turned + self.middle[tracks.frame]

    def moved(self, frames: Float[np.ndarray, "t 6"], points: Float[np.ndarray, "n 3"]) -> RigidMotion:
        """The motion after a step.

        Args:
            frames: Rotation vectors in the camera's axes, about the body's origin, and shifts of the origin.
            points: Changes of the points.

        Returns:
            The motion.
        """
        turn = rotation_matrices(frames[:, :3])
        return RigidMotion(turn @ self.rotation, self.middle + frames[:, 3:], self.points + points)


class BundleAdjustment:
    """The costs of rigid motions: reprojection errors, and distances from a first guess.

    Args:
        tracks: Points in the images.
        focal: Focal length in pixels.
        centre: Principal point in pixels.
        guess: First guess.
    """

    def __init__(self, tracks: TextureTracks, focal: float, centre: Float[np.ndarray, "2"], guess: RigidMotion) -> None:
        self.tracks, self.focal, self.centre, self.guess = tracks, focal, centre, guess
        spans = np.maximum.reduceat(tracks.frame, self._firsts()) - tracks.frame[self._firsts()]
        self.band = 6 * (int(spans.max()) + 1)

    def solve(self) -> RigidMotion:
        """Minimise by damped Gauss-Newton steps, as `carigs.fitting.levenberg_marquardt` does.

        Returns:
            The motion.
        """
        motion, damping = self.guess, DAMPING
        cost = self.cost(motion)
        for _ in range(STEPS):
            equations = self._equations(motion)
            while True:
                moved = motion.moved(*self._step(*equations, damping))
                trial = self.cost(moved)
                if trial < cost or damping > LARGEST_DAMPING:
                    break
                damping *= 4
            if trial >= cost:
                break
            gain, cost, motion, damping = cost - trial, trial, moved, damping / 4
            if gain < TOLERANCE * cost:
                break
        return motion

    def errors(self, motion: RigidMotion) -> Float[np.ndarray, "k 2"]:
        """Reprojection errors.

        Args:
            motion: The motion.

        Returns:
            Projected less observed, in pixels.
        """
        seen = motion.seen(self.tracks)
        return self.focal * seen[:, :2] / seen[:, 2:] + self.centre - self.tracks.pixels

    def cost(self, motion: RigidMotion) -> float:
        """Half the sum of squared errors in standard deviations, with outliers weighted down.

        Args:
            motion: The motion.

        Returns:
            The cost.
        """
        squared = (self.errors(motion) ** 2).sum(axis=1) / SIGMA**2
        residuals = self._prior_residuals(motion) / self._deviations
        places = ((motion.points - self.guess.points) ** 2).sum() / PLACE**2
        return 0.5 * float((squared / (1 + squared / OUTLIER**2)).sum() + (residuals**2).sum() + places)

    @property
    def _deviations(self) -> Float[np.ndarray, "6"]:
        return np.array([TURN] * 3 + [SHIFT] * 2 + [DEPTH])

    def _firsts(self) -> np.ndarray:
        return np.flatnonzero(np.diff(self.tracks.corner, prepend=-1))

    def _prior_residuals(self, motion: RigidMotion) -> Float[np.ndarray, "t 6"]:
        """Poses against the first guess; the rotation by the skew part of the difference, exact for small angles."""
        turn = motion.rotation @ self.guess.rotation.swapaxes(1, 2)
        axis = np.stack([turn[:, i, j] - turn[:, j, i] for i, j in ((2, 1), (0, 2), (1, 0))], axis=1) / 2
        return np.hstack([axis, motion.middle - self.guess.middle])

    def _equations(self, motion: RigidMotion) -> tuple[np.ndarray, np.ndarray, bsr_array, np.ndarray, np.ndarray]:
        """Matrices of frames and points, what couples them, and the gradients."""
        seen, error = motion.seen(self.tracks), self.errors(motion)
        k, t, n = len(seen), len(motion.middle), len(motion.points)
        frame, corner = self.tracks.frame, self.tracks.corner
        squared = (error**2).sum(axis=1) / SIGMA**2
        weight = (1 / SIGMA / (1 + squared / OUTLIER**2))[:, None, None]
        by_seen = np.zeros((k, 2, 3))
        by_seen[:, 0, 0] = by_seen[:, 1, 1] = self.focal / seen[:, 2]
        by_seen[:, :, 2] = -self.focal * seen[:, :2] / seen[:, 2:] ** 2
        by_seen *= weight
        arm = seen - motion.middle[frame]
        by_turn = np.cross(arm[:, None], by_seen)  # a . (r x arm) = r . (arm x a)
        by_frame = np.concatenate([by_turn, by_seen], axis=2)
        by_point = by_seen @ motion.rotation[frame]
        residual = (weight[:, 0] * error)[:, :, None]
        every = np.arange(k)  # sums over the rows of each frame, and of each corner
        of_frame = csr_array((np.ones(k), (frame, every)), shape=(t, k))
        of_corner = csr_array((np.ones(k), (corner, every)), shape=(n, k))

        def summed(of: csr_array, left: np.ndarray, right: np.ndarray) -> np.ndarray:
            products = left.swapaxes(1, 2) @ right
            return (of @ products.reshape(k, -1)).reshape(-1, *products.shape[1:])

        prior = self._deviations**-2.0
        frames = summed(of_frame, by_frame, by_frame) + np.diag(prior)
        points = summed(of_corner, by_point, by_point) + np.eye(3) / PLACE**2
        frame_gradient = summed(of_frame, by_frame, residual)[..., 0] + prior * self._prior_residuals(motion)
        change = (motion.points - self.guess.points) / PLACE**2
        point_gradient = summed(of_corner, by_point, residual)[..., 0] + change
        order = np.argsort(frame, kind="stable")
        ends = np.concatenate([[0], np.cumsum(np.bincount(frame, minlength=t))])
        blocks = (by_frame.swapaxes(1, 2) @ by_point)[order]
        coupling = bsr_array((blocks, corner[order], ends), shape=(6 * t, 3 * n))
        return frames, points, coupling, frame_gradient, point_gradient

    def _step(
        self,
        frames: Float[np.ndarray, "t 6 6"],
        points: Float[np.ndarray, "n 3 3"],
        coupling: bsr_array,
        frame_gradient: Float[np.ndarray, "t 6"],
        point_gradient: Float[np.ndarray, "n 3"],
        damping: float,
    ) -> tuple[Float[np.ndarray, "t 6"], Float[np.ndarray, "n 3"]]:
        t, n = len(frames), len(points)
        inverse = np.linalg.inv(points * (1 + damping * np.eye(3)))
        eliminated = coupling @ bsr_array((inverse, np.arange(n), np.arange(n + 1)), shape=(3 * n, 3 * n))
        coupled = bsr_array(eliminated @ coupling.T, blocksize=(6, 6))
        blocks, column = coupled.data, coupled.indices
        row = np.repeat(np.arange(t), np.diff(coupled.indptr))
        band = np.zeros((self.band, 6 * t))
        below = row >= column
        for i in range(6):
            for j in range(6):
                offset = 6 * (row - column)[below] + i - j
                band[offset[offset >= 0], (6 * column[below] + j)[offset >= 0]] = -blocks[below, i, j][offset >= 0]
        damped = frames * (1 + damping * np.eye(6))
        for i in range(6):
            for j in range(i + 1):
                band[i - j, j::6] += damped[:, i, j]
        right = eliminated @ point_gradient.ravel() - frame_gradient.ravel()
        frame_step = solveh_banded(band, right, lower=True)
        along = (point_gradient.ravel() + coupling.T @ frame_step).reshape(n, 3)
        return frame_step.reshape(t, 6), -np.einsum("nij,nj->ni", inverse, along)
