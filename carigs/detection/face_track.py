"""The landmarks of a face in all images of a camera, and what is odd about them."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32, Int

from carigs.detection.face_tracking import FoundFace, ImageResult
from carigs.detection.likeness import COLOURS
from carigs.detection.mesh_indices import COUNT

SHOWN = 8
"""Runs of images that a message names."""


@dataclass(frozen=True)
class FaceTrack:
    """The landmarks of a face over time."""

    landmarks: Float32[np.ndarray, "t p 3"]
    """x, y in pixels (pixel centres at +0.5), z in the same unit, smaller nearer to the camera; NaN without a face."""
    presence: Float32[np.ndarray, " t"]
    """Probability that they are those of a face; 0 without one."""
    boxes: Float32[np.ndarray, "t 4"]
    """Left, top, right, bottom of the landmarks; NaN without a face."""
    faces: Int[np.ndarray, " t"]
    """How many faces the detector found."""
    jumped: Bool[np.ndarray, " t"]
    """Where the face was elsewhere in the image before, or looked otherwise: a cut, or another person."""
    colours: Float32[np.ndarray, "t k"]
    """By which faces are compared (`carigs.detection.likeness`); NaN without a face."""

    @property
    def found(self) -> Bool[np.ndarray, " t"]:
        """Where there is a face."""
        return self.presence > 0

    def notes(self) -> list[str]:
        """What is odd.

        Returns:
            A line for each kind of problem, with the positions of the images from 0.
        """
        problems = {
            "no face": ~self.found,
            "several faces, of which one is followed": self.faces > 1,
            "the face jumps, as in a cut or to another person": self.jumped,
        }
        return [
            f"{problem}: {where.sum()} of {len(where)} images ({listed(where)})"
            for problem, where in problems.items()
            if where.any()
        ]


def collect(results: Iterable[ImageResult]) -> FaceTrack:
    """Put the results of images together.

    Args:
        results: What `follow_face` yields.

    Returns:
        The track.
    """
    results = list(results)
    unknown = np.full(COLOURS, np.nan, np.float32)
    nothing = FoundFace(np.full((COUNT, 3), np.nan, np.float32), 0.0, np.full(4, np.nan, np.float32), unknown)
    faces = [result.face or nothing for result in results]
    return FaceTrack(
        np.array([face.landmarks for face in faces], np.float32).reshape(-1, COUNT, 3),
        np.array([face.presence for face in faces], np.float32),
        np.array([face.box for face in faces], np.float32).reshape(-1, 4),
        np.array([result.faces for result in results], np.int64),
        np.array([result.jumped for result in results], bool),
        np.array([face.colours for face in faces], np.float32).reshape(-1, COLOURS),
    )


def listed(where: Bool[np.ndarray, " n"], numbers: Int[np.ndarray, " n"] | None = None) -> str:
    """Name some of the images in a message.

    Args:
        where: Which.
        numbers: Of all images, ascending; their positions by default.

    Returns:
        The first of the numbers. Images that follow each other are FIRST-LAST, also if the numbers skip what was not
        looked at.
    """
    numbers = np.arange(len(where)) if numbers is None else numbers
    edges = np.flatnonzero(np.diff(where.astype(int), prepend=0, append=0)).reshape(-1, 2) - (0, 1)
    texts = [f"{first}-{last}" if last > first else str(first) for first, last in numbers[edges].tolist()]
    return ", ".join(texts[:SHOWN]) + (", ..." if len(texts) > SHOWN else "")
