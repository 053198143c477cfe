"""The objective of tracking: reprojection errors of landmarks under unknown identity, cameras and landmark offsets."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from carigs.fitting.head_points import HeadPoints
from carigs.fitting.normal_equations import NormalEquations
from carigs.fitting.objective import Prior
from carigs.tracking.cameras import Cameras

BLOCK = 16
"""Frames whose Jacobians are held at a time."""
SINGULAR = 1e-12
"""Share of a diagonal entry below which what is left of it counts as rounding."""


@dataclass(frozen=True)
class Shared:
    """What all frames share, in one vector: shape coefficients, offsets of the landmarks, parameters of the cameras."""

    shape: int
    """Number of shape coefficients."""
    points: int
    """Number of landmarks with offsets: all or 0."""
    cameras: int
    """Number of free parameters of the cameras, or 0."""

    @property
    def size(self) -> int:
        """Length of the vector."""
        return self.shape + 3 * self.points + self.cameras

    def split(
        self, vector: Float[np.ndarray, " s"]
    ) -> tuple[Float[np.ndarray, " b"], Float[np.ndarray, "n 3"], Float[np.ndarray, " k"]]:
        """The parts of a vector.

        Args:
            vector: What the frames share.

        Returns:
            Shape coefficients, offsets in metres, and parameters of the cameras.
        """
        end = self.shape + 3 * self.points
        return vector[: self.shape], vector[self.shape : end].reshape(-1, 3), vector[end:]


def small_cholesky(matrices: Float[np.ndarray, "*n d d"]) -> Float[np.ndarray, "*n d d"]:
    """Cholesky factors of many small matrices, which may be singular.

    Args:
        matrices: Symmetric, without negative eigenvalues.

    Returns:
        Lower triangular matrices L with L L' = the matrices.
    """
    lower = np.zeros_like(matrices)
    for j in range(matrices.shape[-1]):
        done = lower[..., j, :j]
        pivot = matrices[..., j, j] - (done * done).sum(axis=-1)
        root = np.sqrt(np.where(pivot > SINGULAR * matrices[..., j, j], pivot, 0))
        inverse = np.divide(1, root, out=np.zeros_like(root), where=root > 0)
        rest = matrices[..., j:, j] - np.einsum("...ik,...k->...i", lower[..., j:, :j], done)
        lower[..., j:, j] = rest * inverse[..., None]
    return lower


@dataclass(frozen=True)
class LandmarkObjective:
    """Half the sum of squared errors of landmarks in standard deviations (Geman and McClure), and priors.

    An error of r standard deviations costs r^2 / 2 / (1 + r^2 / k^2), as in `carigs.fitting.landmarks.term`.
    """

    points: HeadPoints
    cameras: Cameras
    shared: Shared
    pixels: Float[np.ndarray, "t c n 2"]
    information: Float[np.ndarray, "t c n 2 2"]
    """Inverse covariances of the errors in 1 / pixels^2, 0 for missing landmarks."""
    outlier: float
    """Standard deviations k beyond which an error counts as an outlier."""
    prior: Prior

    def value(self, frames: Float[np.ndarray, "t q"], shape: Float[np.ndarray, " s"]) -> float:
        """Evaluate.

        Args:
            frames: Parameters of each frame.
            shape: What the frames share.

        Returns:
            The cost.
        """
        points, cameras, coefficients = self._at(shape)
        total = self.prior.value(frames, shape)
        for part in self._blocks(len(frames)):
            pixels, depth = cameras.project(points.positions(frames[part], coefficients))
            total += self._cost(pixels, depth, part)[0]
        return total

    def linearise(
        self, frames: Float[np.ndarray, "t q"], shape: Float[np.ndarray, " s"]
    ) -> tuple[float, NormalEquations]:
        """Evaluate, with the normal equations.

        Args:
            frames: Parameters of each frame.
            shape: What the frames share.

        Returns:
            The cost, and the Gauss-Newton matrix with the gradient.
        """
        equations, total = self.prior.equations(frames, shape), self.prior.value(frames, shape)
        points, cameras, coefficients = self._at(shape)
        for part in self._blocks(len(frames)):
            total += self._add(equations, points, cameras, frames[part], coefficients, part)
        return total, equations

    def errors(self, frames: Float[np.ndarray, "t q"], shape: Float[np.ndarray, " s"]) -> Float[np.ndarray, "t c n"]:
        """Distances between observed and projected landmarks.

        Args:
            frames: Parameters of each frame.
            shape: What the frames share.

        Returns:
            Pixels, NaN for missing landmarks.
        """
        points, cameras, coefficients = self._at(shape)
        pixels, _ = cameras.project(points.positions(frames, coefficients))
        seen = self.information.any(axis=(-2, -1))
        return np.where(seen, np.linalg.norm(pixels - self.pixels, axis=-1), np.nan)

    def weighted_errors(
        self, frames: Float[np.ndarray, "t q"], shape: Float[np.ndarray, " s"]
    ) -> tuple[Float[np.ndarray, "t c n 2"], Float[np.ndarray, "t c n 2 2"]]:
        """Where landmarks are observed, less where the head has them.

        Args:
            frames: Parameters of each frame.
            shape: What the frames share.

        Returns:
            Pixels, 0 for missing landmarks; and the weights that they have in the normal equations, in 1 / pixels^2.
        """
        points, cameras, coefficients = self._at(shape)
        pixels, depth = cameras.project(points.positions(frames, coefficients))
        _, weights, error = self._cost(pixels, depth, slice(None))
        return -error, weights

    def _at(self, shape: Float[np.ndarray, " s"]) -> tuple[HeadPoints, Cameras, Float[np.ndarray, " b"]]:
        coefficients, offsets, camera = self.shared.split(shape)
        points = self.points.with_offsets(offsets) if len(offsets) else self.points
        return points, self.cameras.moved(camera) if len(camera) else self.cameras, coefficients

    def _blocks(self, count: int) -> list[slice]:
        return [slice(first, min(first + BLOCK, count)) for first in range(0, count, BLOCK)]

    def _cost(
        self, pixels: Float[np.ndarray, "t c n 2"], depth: Float[np.ndarray, "t c n"], part: slice
    ) -> tuple[float, Float[np.ndarray, "t c n 2 2"], Float[np.ndarray, "t c n 2"]]:
        """The cost of a block of frames, the weights of its errors, and the errors."""
        information = self.information[part] * (depth > 0)[..., None, None]
        error = np.where(information.any(axis=-1), pixels - self.pixels[part], 0)
        squared = np.einsum("tcna,tcnab,tcnb->tcn", error, information, error, optimize=True)
        relative = 1 + squared / self.outlier**2
        return 0.5 * float((squared / relative).sum()), information / relative[..., None, None] ** 2, error

    def _add(
        self,
        equations: NormalEquations,
        points: HeadPoints,
        cameras: Cameras,
        frames: Float[np.ndarray, "t q"],
        coefficients: Float[np.ndarray, " b"],
        part: slice,
    ) -> float:
        """Add a block of frames to the equations; returns its cost."""
        positions, by_frame, by_shape = points.linearise(frames, coefficients)
        pixels, depth, by_point, by_camera = cameras.linearise(positions)
        cost, weights, error = self._cost(pixels, depth, part)
        weighted = weights @ by_point
        gradient = np.einsum("tcnai,tcna->tni", weighted, error)
        # Each point has rows K with K' K = the sum of D' W D over the cameras: two for one camera, three for more.
        if len(cameras.centres) == 1:
            factor = small_cholesky(weights[:, 0]).swapaxes(-1, -2) @ by_point[:, 0]
        else:
            factor = small_cholesky(np.einsum("tcnai,tcnaj->tnij", weighted, by_point, optimize=True)).swapaxes(-1, -2)
        t, n, k, q = *factor.shape[:3], by_frame.shape[3]
        frame_rows = by_frame.reshape(t, 3 * n, q).swapaxes(1, 2)
        flat_gradient = gradient.reshape(t, 3 * n, 1)
        by_frame = factor @ by_frame
        rows = by_frame.reshape(t, k * n, q)
        equations.frames[part] += rows.swapaxes(1, 2) @ rows
        equations.frame_gradient[part] += (frame_rows @ flat_gradient)[..., 0]
        # The derivatives of a point with respect to what is shared: dense for the shape, its own three for an offset.
        border, shape, slope = equations.border[part], equations.shape, equations.shape_gradient
        b, end = self.shared.shape, self.shared.shape + 3 * self.shared.points
        if b:
            shape_rows = by_shape.reshape(t, 3 * n, b)
            slope[:b] += np.einsum("trb,tr->b", shape_rows, flat_gradient[..., 0])
            by_shape = factor @ by_shape
            border[..., :b] += rows.swapaxes(1, 2) @ by_shape.reshape(t, k * n, b)
            shape[:b, :b] += by_shape.reshape(t * k * n, b).T @ by_shape.reshape(t * k * n, b)
        if self.shared.points:
            turned = points.turned(frames, coefficients)
            by_offset = factor @ turned  # (t, n, k, 3)
            mixed = np.einsum("tnkq,tnkj->tqnj", by_frame, by_offset, optimize=True)
            border[..., b:end] += mixed.reshape(t, q, -1)
            own = np.einsum("tnki,tnkj->nij", by_offset, by_offset)
            index = b + np.arange(3 * n).reshape(n, 3)
            shape[index[:, :, None], index[:, None, :]] += own
            slope[b:end] += np.einsum("tnki,tnk->ni", turned, gradient).ravel()
            if b:
                mixed = np.einsum("tnkb,tnkj->bnj", by_shape, by_offset, optimize=True).reshape(b, -1)
                shape[:b, b:end] += mixed
                shape[b:end, :b] += mixed.T
        for i, by_own in enumerate(np.moveaxis(by_camera, 1, 0) if self.shared.cameras else ()):
            own = end + cameras.own_parameters(i)
            by_own = by_own[..., : len(own)]
            crossed = (weighted[:, i].swapaxes(-1, -2) @ by_own).reshape(t, 3 * n, len(own))
            border[..., own] += frame_rows @ crossed
            weighted_own = weights[:, i] @ by_own
            shape[np.ix_(own, own)] += np.einsum("tnak,tnal->kl", weighted_own, by_own, optimize=True)
            slope[own] += np.einsum("tnak,tna->k", weighted_own, error[:, i], optimize=True)
            if b:
                mixed = np.einsum("trb,trk->bk", shape_rows, crossed, optimize=True)
                shape[:b, own] += mixed
                shape[own, :b] += mixed.T
            if self.shared.points:
                mixed = np.einsum("tnij,tnik->njk", turned, crossed.reshape(t, n, 3, -1)).reshape(-1, len(own))
                shape[b:end, own] += mixed
                shape[own, b:end] += mixed.T
        return cost
