"""Where landmarks come from: a file, a folder with a file per image, or a detector."""

from __future__ import annotations

import importlib.util
import os
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Protocol

import numpy as np
from jaxtyping import Float, UInt8

from carigs.capture import Capture
from carigs.detection import FaceTrack, load_face_networks
from carigs.detection.upright import follow_upright
from carigs.errors import InputError
from carigs.fitting.landmarks.files import Landmarks, read_landmarks
from carigs.readers.arrays import checked_array
from carigs.readers.npz import read_npz


class Detector(Protocol):
    """Finds landmarks in an image."""

    def detect(self, image: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "p 3"] | None:
        """Find the landmarks of the one face.

        Args:
            image: RGB values from 0 to 255.

        Returns:
            x, y in pixels (pixel centres at +0.5) and confidence from 0 to 1; None if there is no face.
        """


class MediapipeDetector:
    """The face landmarks of MediaPipe (478 points of its canonical face mesh).

    Args:
        task: MediaPipe's model file, `face_landmarker.task`.

    Raises:
        InputError: If MediaPipe is not installed, or the file is missing or none of MediaPipe's.
    """

    def __init__(self, task: Path) -> None:
        if not task.is_file():
            raise InputError("no such task file", file=task)
        if importlib.util.find_spec("mediapipe") is None:
            raise InputError("needs the package mediapipe: pip install mediapipe, or give landmarks as .npz", file=task)
        import mediapipe

        vision = mediapipe.tasks.vision
        base = mediapipe.tasks.BaseOptions(model_asset_path=str(task))
        options = vision.FaceLandmarkerOptions(base_options=base)
        try:
            self.landmarker = vision.FaceLandmarker.create_from_options(options)
        except (RuntimeError, ValueError) as error:  # how MediaPipe reports a file that is not one of its own
            problem = " ".join(str(error).split())[:200]
            raise InputError(f"not a task file of MediaPipe's face landmarks ({problem})", file=task) from error
        self.make_image = lambda pixels: mediapipe.Image(image_format=mediapipe.ImageFormat.SRGB, data=pixels)

    def detect(self, image: UInt8[np.ndarray, "h w 3"]) -> Float[np.ndarray, "p 3"] | None:
        """Find the landmarks; see `Detector`. MediaPipe gives no confidence: all are 1.

        Args:
            image: RGB values from 0 to 255.

        Returns:
            The landmarks, or None.
        """
        faces = self.landmarker.detect(self.make_image(image)).face_landmarks
        if not faces:
            return None
        height, width = image.shape[:2]
        return np.array([(point.x * width, point.y * height, 1.0) for point in faces[0]])


def find_landmarks(source: Path | None, capture: Capture) -> Landmarks:
    """Landmarks of all frames of a capture.

    Args:
        source: An .npz file (`carigs.fitting.landmarks.files`); a folder with `{timestep:05d}_{camera:02d}.npz` for
            each image that shows a face, with the array `landmarks` (points, 3); or a .task file of MediaPipe. None
            to find MediaPipe's 478 landmarks by the networks of `carigs.detection`.
        capture: The capture.

    Returns:
        The landmarks.

    Raises:
        InputError: If the source is none of these, cannot be read, or has landmarks in no frame.
        WeightsMissing: If there is no source, and the networks are not there.
    """
    if source is None:
        landmarks, source = _detect(capture), capture.root
    elif source.suffix == ".npz":
        landmarks = read_landmarks(source)
    elif source.is_dir():
        landmarks = _collect({name: _read_one(file) for name, file in _files(source, capture).items()}, capture)
    elif source.suffix == ".task":
        detector = MediapipeDetector(source)
        found = {key: detector.detect(capture.image8(frame)) for key, frame in capture.frame_at.items()}
        landmarks = _collect({key: points for key, points in found.items() if points is not None}, capture)
    else:
        raise InputError("no such landmarks: an .npz file, a folder, or a .task file is expected", file=source)
    landmarks = replace(landmarks, source=str(source))
    timesteps, cameras = sorted({f.timestep for f in capture.frames}), sorted(capture.cameras)
    if not landmarks.at(timesteps, cameras)[..., 2].any():
        raise InputError("holds no landmarks for any frame of the footage: see timesteps and cameras", file=source)
    return landmarks


def _detect(capture: Capture) -> Landmarks:
    """Follow the face in the images of each camera."""
    networks = load_face_networks()
    found = {}
    for camera in capture.cameras:
        frames = [capture.frame_at[key] for key in sorted(capture.frame_at) if key[1] == camera]
        track, _ = follow_upright(partial(map, capture.image8, frames), networks)
        for frame, points in zip(frames, confident_points(track), strict=True):
            found[frame.timestep, camera] = points
    return _collect(found, capture)


def confident_points(track: FaceTrack) -> Float[np.ndarray, "t p 3"]:
    """Landmarks as files of landmarks have them.

    Args:
        track: Landmarks of the images of a camera.

    Returns:
        x, y in pixels, and the probability of the face as the confidence; all 0 without a face.
    """
    points = track.landmarks.astype(np.float64)
    points[..., 2] = track.presence[:, None]
    return np.where(track.found[:, None, None], points, 0)


def _files(folder: Path, capture: Capture) -> dict[tuple[int, int], Path]:
    files = {key: folder / f"{frame.name}.npz" for key, frame in capture.frame_at.items()}
    return {key: file for key, file in files.items() if os.path.lexists(file)}  # a broken link is an error


def _read_one(file: Path) -> Float[np.ndarray, "p 3"]:
    points = checked_array(read_npz(file, required=["landmarks"]), "landmarks", (None, 3), np.float64, file=file)
    if points[:, 2].min(initial=0) < 0 or points[:, 2].max(initial=0) > 1:
        raise InputError("the third column is the confidence, from 0 to 1", file=file, field="landmarks")
    return points


def _collect(found: dict[tuple[int, int], Float[np.ndarray, "p 3"]], capture: Capture) -> Landmarks:
    timesteps, cameras = sorted({f.timestep for f in capture.frames}), sorted(capture.cameras)
    counts = {len(points) for points in found.values()} or {0}
    if len(counts) > 1:
        raise InputError(f"frames have {min(counts)} to {max(counts)} landmarks", file=capture.root, field="landmarks")
    values = np.zeros((len(timesteps), len(cameras), counts.pop(), 3))
    for (timestep, camera), points in found.items():
        values[timesteps.index(timestep), cameras.index(camera)] = points
    return Landmarks(values, np.array(timesteps), np.array(cameras))
