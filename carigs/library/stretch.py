"""Whether a driven head stretches its triangles more than the capture did."""

from __future__ import annotations

import warnings
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from carigs.errors import CarigsWarning
from carigs.exaggeration import Caricature
from carigs.head import pose

if TYPE_CHECKING:
    from carigs.splat.rig.head_sequence import HeadSequence

BOUND = 1.5
"""Stretch over the largest one of the capture that is warned of."""
SAMPLES = 40
"""Most frames of the capture that are compared with."""


class StretchCheck:
    """The largest stretch of every triangle over a motion, beside that of the capture.

    The stretch is the largest singular value of the map from the triangle at rest to the posed one.
    """

    def __init__(self, sequence: HeadSequence, caricature: Caricature | None) -> None:
        """Measure the capture.

        Args:
            sequence: Head, and its parameters over time.
            caricature: The caricature whose triangles are at rest; None for the natural head.
        """
        rest = sequence.head.v_template.astype(np.float64)
        if caricature is not None:
            rest = rest + caricature.displacement
        self._faces, self._inverse = sequence.head.faces, _inverse_edges(rest, sequence.head.faces)
        timesteps = sorted(sequence.parameters)
        picked = np.unique(np.linspace(0, len(timesteps) - 1, min(len(timesteps), SAMPLES)).round().astype(int))
        self._known = np.ones(len(self._faces))
        self._found = np.ones(len(self._faces))
        for place in picked:
            vertices = pose(sequence.head, sequence.parameters[timesteps[place]], caricature)
            self._known = np.maximum(self._known, self._stretch(vertices))

    def add(self, vertices: Float[np.ndarray, "v 3"]) -> None:
        """Measure a frame.

        Args:
            vertices: The posed head.
        """
        self._found = np.maximum(self._found, self._stretch(vertices))

    @property
    def ratio(self) -> Float[np.ndarray, " f"]:
        """Stretch of every triangle over that of the capture, in which it is at least 1."""
        return self._found / self._known

    def warn(self) -> None:
        """Warn if triangles are stretched beyond `BOUND` of the capture.

        Warns:
            CarigsWarning: How many, and by how much.
        """
        far = self.ratio > BOUND
        if far.any():
            text = f"{far.sum()} of {len(far)} triangles are stretched up to {self.ratio.max():.1f} times the most"
            warnings.warn(CarigsWarning(f"motion: {text} of the avatar's capture: weaken the motion"), stacklevel=3)

    def _stretch(self, vertices: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, " f"]:
        a, b = _edges(vertices, self._faces)
        inverse = self._inverse
        first, second = inverse[:, 0, 0, None] * a, inverse[:, 0, 1, None] * a + inverse[:, 1, 1, None] * b
        aa, bb, ab = (np.einsum("fc,fc->f", *pair) for pair in ((first, first), (second, second), (first, second)))
        return np.sqrt(0.5 * (aa + bb + np.sqrt((aa - bb) ** 2 + 4 * ab**2)))


def _edges(vertices: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    corners = vertices[faces]
    return corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]


def _inverse_edges(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Inverse of the upper triangular matrix of a triangle's edges in its own plane; 0 where it has no area."""
    a, b = _edges(vertices, faces)
    length = np.linalg.norm(a, axis=1)
    along = np.einsum("fc,fc->f", a, b) / np.maximum(length, 1e-12)
    height = np.sqrt(np.maximum(np.einsum("fc,fc->f", b, b) - along**2, 0))
    sound = (length > 1e-7) & (height > 1e-7)
    inverse = np.zeros((len(faces), 2, 2))
    safe = np.where(sound, length, 1), np.where(sound, height, 1)
    inverse[:, 0, 0], inverse[:, 1, 1] = 1 / safe[0], 1 / safe[1]
    inverse[:, 0, 1] = -along / (safe[0] * safe[1])
    inverse[~sound] = 0
    return inverse
