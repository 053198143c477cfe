"""From the frames of one static camera to a tracked head: which frames count, their landmarks, the solver."""

from __future__ import annotations

from dataclasses import dataclass
from math import radians, tan

import numpy as np
from jaxtyping import Float, Int

from carigs.detection import FaceTrack
from carigs.errors import InputError
from carigs.fitting.fitted_parameters import fitted_parameters
from carigs.footage import Footage
from carigs.footage.cuts import find_cuts
from carigs.footage.measures import FrameMeasures
from carigs.head import HeadModel, SurfacePoints
from carigs.tracking.cameras import Cameras
from carigs.tracking.landmark_tracking import TrackedHead, Tracks, track_landmarks
from carigs.tracking.skull_motion import skull_motion

SHAPES = 30
"""Identity coefficients: landmarks of one camera determine no more."""
FIELD_OF_VIEW = radians(60)
"""Along the longer side of the image, where nothing is known: a telephone's or a webcam's."""
SQUARE = 1.2
"""Ratio of the sides below which a video is a part of a larger image: no camera records squares."""
DISTANCE, FACE_WIDTH = 1.0, 0.15
"""Metres from the camera that filmed such a part, and width of a face."""
GUESSED, STATED = 0.15, 0.02
"""Standard deviations of the logarithm of a focal length that is guessed, or that metadata state."""
LEAST_FRAMES = 10
"""That show a face, in one take."""
LEAST_PRESENCE = 0.5
"""Probability of the face below which a frame is left out."""


@dataclass(frozen=True)
class FootageTrack:
    """A head in footage."""

    kept: Int[np.ndarray, " t"]
    """Positions of the frames that are tracked, among those of the footage."""
    left_out: dict[str, Int[np.ndarray, " _"]]
    """Positions of the others by the reason."""
    landmarks: Float[np.ndarray, "t n 2"]
    """In pixels."""
    head: TrackedHead
    focal_guess: float
    """Pixels: where the estimate began."""


def track_footage(
    footage: Footage,
    faces: FaceTrack,
    measures: FrameMeasures,
    model: HeadModel,
    embedding: SurfacePoints,
    numbers: Int[np.ndarray, " n"],
    *,
    focal_length: float | None = None,
) -> FootageTrack:
    """Track the head of a person before one static camera.

    Args:
        footage: The frames.
        faces: Their landmarks.
        measures: Their measures.
        model: The head model.
        embedding: Landmarks on the head model.
        numbers: Which of the detector's landmarks these are.
        focal_length: In pixels of the footage; None for what its metadata say, or a guess.

    Returns:
        The head in the frames of the longest take.

    Raises:
        InputError: If too few frames in a row show a face.
    """
    kept, left_out = _kept_frames(footage, faces, measures)
    pixels = faces.landmarks[kept][:, numbers, :2].astype(np.float64)
    tracks = Tracks(
        pixels[:, None],
        np.repeat(faces.presence[kept][:, None, None].astype(np.float64), len(numbers), axis=2),
        footage.times[kept],
    )
    size = np.array([footage.width, footage.height], np.float64)
    stated = focal_length or footage.focal_length
    guess = stated or guessed_focal_length(footage, pixels)
    # World: the camera at the origin, which looks along -z; y up.
    cameras = Cameras(np.array([guess]), size[None] / 2, np.array([[np.pi, 0.0, 0, 0, 0, 0]]))
    fitted = fitted_parameters(model, np.unique(embedding.corners), max_shape=SHAPES)
    deviation = STATED if stated else GUESSED
    shown = set(kept.tolist())
    images = (image for k, image in enumerate(footage.decode()) if k in shown)
    skull = skull_motion(images, model, fitted, embedding, pixels, cameras)
    head = track_landmarks(model, fitted, embedding, tracks, cameras, focal_deviation=deviation, skull=skull)
    return FootageTrack(kept, left_out, pixels, head, guess)


def guessed_focal_length(footage: Footage, landmarks: Float[np.ndarray, "t n 2"]) -> float:
    """Guess a focal length, which landmarks hardly determine.

    Args:
        footage: The frames.
        landmarks: Of the face, in pixels.

    Returns:
        Pixels: of a field of view of 60 degrees; for frames that are nearly square, such that the face is one metre
        away.
    """
    sides = sorted((footage.width, footage.height))
    if sides[1] > SQUARE * sides[0]:
        return sides[1] / 2 / tan(FIELD_OF_VIEW / 2)
    width = float(np.median(np.ptp(landmarks[..., 0], axis=1)))
    return DISTANCE * width / FACE_WIDTH


def _kept_frames(
    footage: Footage, faces: FaceTrack, measures: FrameMeasures
) -> tuple[Int[np.ndarray, " t"], dict[str, Int[np.ndarray, " _"]]]:
    """Frames of the longest take in which the face is the same, and the others by reason."""
    count = len(faces.found)
    cuts = np.union1d(find_cuts(measures), np.flatnonzero(faces.jumped))
    take = np.searchsorted(cuts, np.arange(count), side="right")
    good = faces.presence >= LEAST_PRESENCE
    longest = np.bincount(take[good], minlength=1).argmax() if good.any() else 0
    left_out = {
        "no face": np.flatnonzero(~good),
        "another take, before or after a cut": np.flatnonzero(good & (take != longest)),
    }
    kept = np.flatnonzero(good & (take == longest))
    if len(kept) < LEAST_FRAMES:
        problem = f"{len(kept)} of {count} frames show a face in one take; at least {LEAST_FRAMES} are needed"
        raise InputError(problem, file=footage.source)
    return kept, {reason: frames for reason, frames in left_out.items() if len(frames)}
