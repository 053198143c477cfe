"""Calibrated video without head parameters.

It is an index in the layout of GaussianAvatars, less `flame_param_path`, or what `carigs.capture.importers` reads:
folders of images with a COLMAP model or cameras.json.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from carigs.capture import Capture
from carigs.capture.calibration.camera_table import CameraTable
from carigs.capture.calibration.keys import TRANSFORMS, CalibrationKeys
from carigs.capture.dataset_checks import sound_frames
from carigs.capture.dataset_writer import parameter_file
from carigs.capture.gaussian_avatars import read_index
from carigs.capture.importers.calibrated_images import CALIBRATIONS, find_calibration, read_calibrated_images
from carigs.capture.importers.cameras import read_cameras
from carigs.capture.splits import split_single_sequence
from carigs.errors import InputError, SettingsError
from carigs.fitting.landmarks.files import Landmarks
from carigs.fitting.triangulation import projection_matrices
from carigs.readers.file_names import INDEXES

INDEX = "transforms.json"
"""The index of a video without splits."""


def read_footage(
    folder: Path,
    head_model: Path,
    *,
    calibration: Path | None = None,
    metres_per_unit: float = 1.0,
    background: float = 1.0,
) -> Capture:
    """Index a calibrated video.

    Args:
        folder: Folder with `transforms_{train,val,test}.json`, or `transforms.json` for all frames; or with images and
            a calibration (`read_calibrated_images`).
        head_model: File of the head model.
        calibration: cameras.json or a COLMAP model, in place of what the folder has.
        metres_per_unit: Size of the unit of cameras.json or the COLMAP model.
        background: Grey value that the images were composited on.

    Returns:
        A capture whose files of head parameters need not exist. Without splits in the files, the first 70 % of the
        timesteps are for training.

    Raises:
        InputError: If there is no index or calibration, an entry or camera is not valid, or an image is missing or of
            another size.
        SettingsError: If the unit is not a positive number, or is given for transforms, which are in metres.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("no such folder", file=folder)
    indexes = {split: folder / name for split, name in INDEXES.items()}
    indexes = {split: file for split, file in indexes.items() if file.exists()}
    if calibration is None and (indexes or (folder / INDEX).exists()):
        if metres_per_unit != 1:
            raise SettingsError("transforms are in metres: --metres-per-unit is for cameras.json and COLMAP models")
        return _read_indexes(folder, indexes, Path(head_model), background)
    calibration = calibration or find_calibration(folder)
    if calibration is None:
        raise InputError(f"no calibration; looked for {', '.join((INDEX, *CALIBRATIONS))}", file=folder)
    cameras, warnings = read_cameras(calibration, metres_per_unit)
    found = read_calibrated_images(folder, head_model, cameras, background=background)
    return replace(found, warnings=(*warnings, *found.warnings))


def _read_indexes(folder: Path, indexes: Mapping[str, Path], head_model: Path, background: float) -> Capture:
    """Frames of the index of each split, or of the one index."""
    files = indexes or {"train": folder / INDEX}
    table, keys = CameraTable(), CalibrationKeys(TRANSFORMS)
    listed = [
        entry._replace(frame=replace(entry.frame, parameters=parameter_file(entry.frame.timestep)))
        for split, file in files.items()
        for entry in read_index(file, split, table, keys, with_heads=False)
    ]
    if not listed:
        raise InputError("no frames", file=next(iter(files.values())), field="frames")
    found = sound_frames(folder, listed, table, None)
    frames = sorted(found.frames, key=lambda frame: (frame.timestep, frame.camera))
    divided = tuple(frames) if indexes else split_single_sequence(frames)
    warnings = (*keys.warnings(), *found.warnings)
    return Capture(folder, head_model, divided, tuple(table.cameras), background, warnings=warnings)


def frame_landmarks(
    capture: Capture, landmarks: Landmarks, timesteps: Sequence[int], cameras: Sequence[int]
) -> Float[np.ndarray, "t c p 3"]:
    """Landmarks of the frames of a capture.

    Args:
        capture: The capture.
        landmarks: Its landmarks; those of frames that it lacks do not count.
        timesteps: Timesteps.
        cameras: Numbers of cameras.

    Returns:
        x, y, confidence; all 0 where missing.
    """
    known = [[(t, c) in capture.frame_at for c in cameras] for t in timesteps]
    return landmarks.at(timesteps, cameras) * np.array(known)[..., None, None]


def frame_projections(
    capture: Capture, timesteps: Sequence[int], cameras: Sequence[int]
) -> Float[np.ndarray, "t c 3 4"]:
    """Projection matrices of frames; for missing frames those of the camera's first frame.

    Args:
        capture: The capture.
        timesteps: Timesteps.
        cameras: Numbers of cameras.

    Returns:
        Matrices by timestep and camera.
    """
    known, first = capture.frame_at, capture.cameras
    rows = [[capture.camera(known[t, c]) if (t, c) in known else first[c] for c in cameras] for t in timesteps]
    return np.array([projection_matrices(row) for row in rows]).reshape(len(timesteps), len(cameras), 3, 4)


def frame_sizes(capture: Capture, timesteps: Sequence[int], cameras: Sequence[int]) -> Float[np.ndarray, "t c 2"]:
    """Sizes of the images of frames; for missing frames those of the camera's first frame.

    Args:
        capture: The capture.
        timesteps: Timesteps.
        cameras: Numbers of cameras.

    Returns:
        Width and height in pixels.
    """
    known, first = capture.frame_at, capture.cameras
    rows = [[capture.camera(known[t, c]) if (t, c) in known else first[c] for c in cameras] for t in timesteps]
    return np.array([[(camera.width, camera.height) for camera in row] for row in rows], np.float64)
