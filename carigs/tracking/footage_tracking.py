"""From recordings to a tracked head: which frames count, their landmarks, guesses of focal lengths, the solver."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import radians, sqrt, tan

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.detection.mesh_indices import LEFT_IRIS, RIGHT_IRIS
from carigs.errors import InputError
from carigs.fitting.fitted_parameters import fitted_parameters
from carigs.head import HeadModel, SurfacePoints
from carigs.tracking.camera_placement import linked
from carigs.tracking.cameras import Cameras
from carigs.tracking.recording import Recording
from carigs.tracking.skin.between_views import SimultaneousViews
from carigs.tracking.solver.landmark_tracking import TrackedHead, track_landmarks
from carigs.tracking.solver.tracks import Tracks
from carigs.tracking.takes import in_image, kept_frames, shows_face
from carigs.tracking.texture.skull_motion import skull_motion

SHAPES = 30
"""Identity coefficients: landmarks of one camera determine no more."""
FIELD_OF_VIEW = radians(60)
"""Along the longer side of the image, where nothing is known: a telephone's or a webcam's."""
SQUARE = 1.2
"""Ratio of the sides below which a video is a part of a larger image: no camera records squares."""
DISTANCE, FACE_WIDTH = 1.0, 0.15
"""Metres from the camera that filmed such a part, or from one of several cameras on stands; and width of a face."""
GUESSED, STATED = 0.15, 0.02
"""Standard deviations of the logarithm of a focal length that is guessed, or that metadata state."""
LEAST_VIEWS = 3
"""That show a face, of one moment."""


@dataclass(frozen=True)
class ChosenFrames:
    """What is tracked of recordings: t timesteps by c cameras."""

    kept: Int[np.ndarray, " t"]
    """Positions of the frames among those of a recording."""
    cameras: Int[np.ndarray, " c"]
    """The recordings."""
    faces: Bool[np.ndarray, "t c"]
    """Which of the frames show the face."""
    left_out: tuple[tuple[str, ...], ...]
    """Of each recording and frame: why it is left out; empty if it is not."""


@dataclass(frozen=True)
class FootageTrack:
    """A head in recordings of t timesteps by c cameras."""

    kept: Int[np.ndarray, " t"]
    """Positions of the frames that are tracked, among those of a recording."""
    cameras: Int[np.ndarray, " c"]
    """The recordings that are tracked."""
    left_out: tuple[tuple[str, ...], ...]
    """Of each recording and frame: why it gave no landmarks; empty if it did."""
    landmarks: Float[np.ndarray, "t c n 2"]
    """In pixels; NaN in frames without a face."""
    head: TrackedHead
    focal_guesses: Float[np.ndarray, " c"]
    """Pixels: where the estimate began."""

    @property
    def one_moment(self) -> bool:
        """Whether all cameras show one timestep."""
        return len(self.kept) == 1


def choose_frames(recordings: Sequence[Recording]) -> ChosenFrames:
    """Choose the frames that are tracked: those of the longest shot.

    Args:
        recordings: As many frames of each camera; one of each for photographs of a moment, or an orbit.

    Returns:
        The frames.

    Raises:
        InputError: If too few frames in a row show a face, or a camera never sees it together with another one.
    """
    one_moment = len(recordings[0].footage) == 1
    kept, left_out = kept_frames(recordings)
    faces = np.array([shows_face(recording)[kept] for recording in recordings]).T
    cameras = np.flatnonzero(faces.any(axis=0)) if one_moment else np.arange(len(recordings))
    if one_moment and len(cameras) < LEAST_VIEWS:
        problem = f"{len(cameras)} of {len(recordings)} images show a face; at least {LEAST_VIEWS} are needed"
        raise InputError(problem, file=recordings[0].footage.source)
    if not (seen := linked(faces[:, cameras])).all():
        problem = "shows the face in no frame in which another camera sees it, too: their places cannot be found"
        raise InputError(problem, file=recordings[cameras[~seen][0]].footage.source)
    return ChosenFrames(kept, cameras, faces[:, cameras], left_out)


def track_footage(
    recordings: Sequence[Recording],
    chosen: ChosenFrames,
    model: HeadModel,
    embedding: SurfacePoints,
    numbers: Int[np.ndarray, " n"],
    *,
    focal_lengths: Sequence[float | None] | None = None,
) -> FootageTrack:
    """Track the head of a person before cameras that stand still, or of one moment.

    Args:
        recordings: As many frames of each camera; one of each for photographs of a moment, or an orbit.
        chosen: Those that are tracked.
        model: The head model.
        embedding: Landmarks on the head model.
        numbers: Which of the detector's landmarks these are.
        focal_lengths: In pixels of the footage; None for what its metadata say, or a guess.

    Returns:
        The head.

    Raises:
        CarigsError: If the landmarks place the head model in no frame, or not before a camera and another one at once.
    """
    kept, cameras, faces = chosen.kept, chosen.cameras, chosen.faces
    one_moment, used = len(recordings[0].footage) == 1, [recordings[c] for c in cameras]
    pixels = np.stack([r.faces.landmarks[kept][:, numbers, :2].astype(np.float64) for r in used], axis=1)
    pixels[~faces] = np.nan
    presence = np.stack([r.faces.presence[kept] for r in used], axis=1).astype(np.float64) * faces
    seen_points = np.stack([in_image(pixels[:, c], r.footage) for c, r in enumerate(used)], axis=1)
    confidence = presence[..., None] * seen_points * _gaze_weights(numbers)
    tracks = Tracks(np.nan_to_num(pixels), confidence, used[0].footage.times[kept])
    given = focal_lengths or [None] * len(recordings)
    stated = [given[c] or r.footage.focal_length for c, r in zip(cameras, used, strict=True)]
    lenses = _lenses(used, stated) if one_moment else np.arange(len(used))
    guesses = _focal_guesses(used, pixels, stated, lenses)
    # World: the first camera at the origin, which looks along -z; y up.
    first = np.array([np.pi, 0, 0, 0, 0, 0])
    centres = np.array([(r.footage.width / 2, r.footage.height / 2) for r in used])
    start = Cameras(guesses, centres, np.tile(first, (len(used), 1)), lenses)
    deviations = np.empty(start.lens_count)
    deviations[lenses] = [STATED if value else GUESSED for value in stated]
    if len(used) > 1:
        # More images do not tell more: errors of a network are those of the face, and they are the same in all images.
        deviations /= sqrt(len(used) if one_moment else len(kept))
    fitted = fitted_parameters(model, np.unique(embedding.corners), max_shape=SHAPES)
    skull = views = None
    if len(used) > 1:
        views = SimultaneousViews([recording.footage.at(kept) for recording in used], faces)
    elif not one_moment:  # before several cameras, parallax tells how the head turns
        skull = skull_motion(used[0].footage.at(kept).decode(), model, fitted, embedding, pixels[:, 0], start)
    head = track_landmarks(
        model, fitted, embedding, tracks, start, focal_deviation=deviations, skull=skull, views=views
    )
    return FootageTrack(kept, cameras, chosen.left_out, pixels, head, guesses)


def _gaze_weights(numbers: Int[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """Weights of landmarks: 0 for the edge of an iris whose centre is known, 1 for the others.

    Lids hide half of the edge, and on an eyeball of another size it moves otherwise than the centre when the eye turns.
    """
    edges = [edge for centre, *edge in (LEFT_IRIS, RIGHT_IRIS) if centre in numbers]
    return 1.0 - np.isin(numbers, edges)


def _lenses(recordings: Sequence[Recording], stated: Sequence[float | None]) -> Int[np.ndarray, " c"]:
    """Photographs of one size and one stated focal length were taken through one lens."""
    sizes = [sorted((r.footage.width, r.footage.height)) for r in recordings]
    keys = [(*size, round(focal or 0, 1)) for size, focal in zip(sizes, stated, strict=True)]
    return np.array([sorted({*keys}).index(key) for key in keys])


def _focal_guesses(
    recordings: Sequence[Recording],
    pixels: Float[np.ndarray, "t c n 2"],
    stated: Sequence[float | None],
    lenses: Int[np.ndarray, " c"],
) -> Float[np.ndarray, " c"]:
    """First value of each camera's focal length, equal for those with one lens."""
    several = len(recordings) > 1 and len(pixels) > 1
    guesses = np.array([
        focal or guessed_focal_length(r.footage.width, r.footage.height, pixels[:, c], on_stands=several)
        for c, (r, focal) in enumerate(zip(recordings, stated, strict=True))
    ])  # fmt: skip
    return np.array([np.median(guesses[lenses == lens]) for lens in lenses])


def guessed_focal_length(
    width: int, height: int, landmarks: Float[np.ndarray, "t n 2"], *, on_stands: bool = False
) -> float:
    """Guess a focal length, which landmarks hardly determine.

    Args:
        width: Of the images, in pixels.
        height: Of the same.
        landmarks: Of the face, in pixels; NaN where there are none.
        on_stands: Whether the camera is one of several, which stand farther away than an arm's length.

    Returns:
        Pixels: of a field of view of 60 degrees; for frames that are nearly square, such that the face is one metre
        away; for cameras on stands, the larger of both.
    """
    sides = sorted((width, height))
    by_view = sides[1] / 2 / tan(FIELD_OF_VIEW / 2)
    known = landmarks[np.isfinite(landmarks).all(axis=(1, 2))]
    by_distance = DISTANCE * float(np.median(np.ptp(known[..., 0], axis=1))) / FACE_WIDTH if len(known) else by_view
    if sides[1] <= SQUARE * sides[0]:
        return by_distance
    return max(by_view, by_distance) if on_stands else by_view
