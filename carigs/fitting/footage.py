"""Calibrated video without head parameters: indexes in the layout of GaussianAvatars, less `flame_param_path`."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from carigs.capture import Capture
from carigs.capture.camera_table import CameraTable
from carigs.capture.dataset_checks import ListedFrame, sound_frames
from carigs.capture.dataset_writer import parameter_file
from carigs.capture.frame import SPLITS
from carigs.capture.gaussian_avatars import read_frame
from carigs.capture.splits import split_single_sequence
from carigs.errors import InputError
from carigs.fitting.triangulation import projection_matrices
from carigs.readers.json_files import json_field, read_json


def read_footage(folder: Path, head_model: Path, *, background: float = 1.0) -> Capture:
    """Index a calibrated video: `transforms_{train,val,test}.json`, or `transforms.json` for all frames.

    Args:
        folder: The folder.
        head_model: File of the head model.
        background: Grey value that the images were composited on.

    Returns:
        A capture whose files of head parameters need not exist. Without splits in the files, the first 70 % of the
        timesteps are for training.

    Raises:
        InputError: If there is no index, an entry or camera is not valid, or an image is missing or of another size.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("no such folder", file=folder)
    files = {split: folder / f"transforms_{split}.json" for split in SPLITS}
    files = {split: file for split, file in files.items() if file.exists()}
    divided = bool(files)
    if not divided:
        files = {"train": folder / "transforms.json"}
    listed, table = [], CameraTable()
    for split, file in files.items():
        content = read_json(file, dict)
        for i, entry in enumerate(json_field(content, "frames", list, file=file)):
            named = {**entry, "flame_param_path": "-"} if isinstance(entry, dict) else entry
            frame = read_frame(named, content, split, file, f"frames[{i}]", table)
            frame = replace(frame, parameters=parameter_file(frame.timestep))
            listed.append(ListedFrame(frame, file, f"frames[{i}]"))
    if not listed:
        raise InputError("no frames", file=next(iter(files.values())), field="frames")
    frames = sorted(sound_frames(folder, listed, table, None), key=lambda frame: (frame.timestep, frame.camera))
    return Capture(
        folder,
        Path(head_model),
        tuple(frames) if divided else split_single_sequence(frames),
        tuple(table.cameras),
        background,
    )


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
    return np.stack([projection_matrices(row) for row in rows])
