"""The objective of a fit: data terms on points of the posed head, priors on coefficients, temporal smoothness."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import Float

from carigs.fitting.head_points import HeadPoints
from carigs.fitting.normal_equations import NormalEquations

CHUNK = 1 << 21
"""Entries of a Jacobian that are held at a time, per block of frames."""


class PointCost(NamedTuple):
    """A cost as a function of points, to second order (Gauss-Newton)."""

    value: float
    gradient: Float[np.ndarray, "t n 3"]
    """Per metre."""
    curvature: Float[np.ndarray, "t n 3 3"]


class DataTerm(Protocol):
    """A cost of the positions of points on the head; each point counts for itself."""

    points: HeadPoints

    def evaluate(self, positions: Float[np.ndarray, "t n 3"], frames: slice) -> PointCost:
        """Compare points with the images.

        Args:
            positions: World points of the frames.
            frames: The frames.

        Returns:
            The cost.
        """


@dataclass(frozen=True)
class Prior:
    """Gaussian priors about 0; a precision is 1 / variance, 0 for parameters without a prior."""

    frames: Float[np.ndarray, " q"]
    shape: Float[np.ndarray, " s"]
    links: Float[np.ndarray, "m q"]
    """Precisions of the differences between neighbouring frames: one row less than frames."""

    def value(self, frames: Float[np.ndarray, "t q"], shape: Float[np.ndarray, " s"]) -> float:
        """Half the sum of the squared distances from 0, in standard deviations.

        Args:
            frames: Parameters of each frame.
            shape: Shape coefficients.

        Returns:
            The cost.
        """
        change = np.diff(frames, axis=0)
        return 0.5 * float((frames**2 @ self.frames).sum() + shape**2 @ self.shape + (self.links * change**2).sum())

    def equations(self, frames: Float[np.ndarray, "t q"], shape: Float[np.ndarray, " s"]) -> NormalEquations:
        """Normal equations of the priors alone.

        Args:
            frames: Parameters of each frame.
            shape: Shape coefficients.

        Returns:
            Matrix and gradient.
        """
        (t, q), s = frames.shape, len(shape)
        equations = NormalEquations(
            frames=np.tile(np.diag(self.frames), (t, 1, 1)),
            links=-self.links,
            border=np.zeros((t, q, s)),
            shape=np.diag(self.shape),
            frame_gradient=self.frames * frames,
            shape_gradient=self.shape * shape,
        )
        diagonal = np.einsum("tqq->tq", equations.frames)
        pull = self.links * np.diff(frames, axis=0)
        for side, sign in ((slice(None, -1), -1), (slice(1, None), 1)):
            diagonal[side] += self.links
            equations.frame_gradient[side] += sign * pull
        return equations


@dataclass(frozen=True)
class Objective:
    """Half a sum of squares (robust, weighted): the negative logarithm of the posterior density."""

    terms: Sequence[DataTerm]
    prior: Prior

    def value(self, frames: Float[np.ndarray, "t q"], shape: Float[np.ndarray, " s"]) -> float:
        """Evaluate.

        Args:
            frames: Parameters of each frame.
            shape: Shape coefficients.

        Returns:
            The cost.
        """
        total = self.prior.value(frames, shape)
        for term in self.terms:
            for part in _blocks(term, len(frames)):
                total += term.evaluate(term.points.positions(frames[part], shape), part).value
        return total

    def linearise(
        self, frames: Float[np.ndarray, "t q"], shape: Float[np.ndarray, " s"]
    ) -> tuple[float, NormalEquations]:
        """Evaluate, with the normal equations.

        Args:
            frames: Parameters of each frame.
            shape: Shape coefficients.

        Returns:
            The cost, and the Gauss-Newton matrix with the gradient.
        """
        total, equations = self.prior.value(frames, shape), self.prior.equations(frames, shape)
        for term in self.terms:
            for part in _blocks(term, len(frames)):
                positions, *jacobians = term.points.linearise(frames[part], shape)
                cost = term.evaluate(positions, part)
                total += cost.value
                rows = positions.shape[0], 3 * positions.shape[1]
                transposed = [jacobian.reshape(*rows, jacobian.shape[-1]).swapaxes(1, 2) for jacobian in jacobians]
                curved = [(cost.curvature @ j).reshape(*rows, j.shape[-1]) for j in jacobians]
                pull = [(j @ cost.gradient.reshape(*rows, 1))[..., 0] for j in transposed]
                equations.frames[part] += transposed[0] @ curved[0]
                equations.border[part] += transposed[0] @ curved[1]
                equations.shape += (transposed[1] @ curved[1]).sum(axis=0)
                equations.frame_gradient[part] += pull[0]
                equations.shape_gradient += pull[1].sum(axis=0)
        return total, equations


def _blocks(term: DataTerm, count: int) -> list[slice]:
    """Frames in blocks whose Jacobians take little memory."""
    fitted = term.points.fitted
    size = max(1, CHUNK // (3 * len(term.points.barycentric) * (fitted.frame_size + len(fitted.shape))))
    return [slice(first, min(first + size, count)) for first in range(0, count, size)]
