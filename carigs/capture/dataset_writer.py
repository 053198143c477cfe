"""Writer of the folder layout of GaussianAvatars and VHAP, the inverse of `read_dataset`."""

from __future__ import annotations

import json
import math
import os
import shutil
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from carigs.capture.camera import OPENCV_FROM_OPENGL, Camera
from carigs.capture.dataset import Capture
from carigs.capture.dataset_paths import file_inside
from carigs.capture.frame import Frame
from carigs.errors import InputError
from carigs.head import HeadModel, HeadParameters
from carigs.readers.file_names import INDEXES, SPLITS
from carigs.readers.folders import is_system_file
from carigs.system.files import writing_folder

OPEN_JAW = (0.3, 0.0, 0.0)
"""Rotation of the jaw in `canonical_flame_param.npz`, as VHAP writes it."""

Place = Callable[[Path, Path, Path, str], str]
"""Puts a source file into the folder that is being written, for a dataset folder, by a name; returns its path there."""


def copied(source: Path, part: Path, folder: Path, name: str) -> str:
    """Copy a file into a dataset.

    Args:
        source: The file.
        part: Folder that becomes the dataset.
        folder: The dataset.
        name: Path in the dataset.

    Returns:
        The path in the dataset.
    """
    shutil.copyfile(source, part / name)
    return name


def linked(source: Path, part: Path, folder: Path, name: str) -> str:
    """Link a file into a dataset.

    Args:
        source: As of `copied`.
        part: As of `copied`.
        folder: As of `copied`.
        name: As of `copied`.

    Returns:
        The path in the dataset.
    """
    (part / name).symlink_to(source.resolve())
    return name


def referenced(source: Path, part: Path, folder: Path, name: str) -> str:
    """Leave a file beside a dataset where it is, and link others into it.

    Args:
        source: As of `copied`.
        part: As of `copied`.
        folder: As of `copied`.
        name: As of `copied`.

    Returns:
        The path from the dataset.
    """
    try:
        return file_inside(os.path.relpath(os.path.abspath(source), folder), folder, name)
    except InputError:
        return linked(source, part, folder, name)


def check_target(folder: Path) -> None:
    """Refuse a folder whose contents would be lost, or that cannot be made.

    Args:
        folder: The folder that a dataset is to be written to.

    Raises:
        InputError: If the folder holds something, or a part of its path is a file or cannot be written to.
    """
    made = next(path for path in (folder, *folder.absolute().parents) if path.exists())
    if not made.is_dir():
        raise InputError("is a file; the output is a folder", file=made, remedy="name another folder")
    if not os.access(made, os.W_OK | os.X_OK):
        raise InputError("cannot be written to", file=made, remedy="name another folder for the output")
    if made == folder and not all(is_system_file(file.name) for file in folder.iterdir()):
        raise InputError("is not empty; nothing is overwritten", file=folder)


def write_dataset(
    folder: Path,
    capture: Capture,
    model: HeadModel,
    parameters: Mapping[int, HeadParameters],
    *,
    place: Place = referenced,
) -> None:
    """Write a dataset with its head model.

    Args:
        folder: Folder to create.
        capture: Frames and cameras.
        model: The head model.
        parameters: Head parameters by timestep; frames of other timesteps are left out.
        place: What happens to images: `copied`, `linked` or `referenced`.

    Raises:
        InputError: If the folder holds something.
    """
    check_target(folder)
    folder = Path(os.path.abspath(folder))
    with writing_folder(folder) as part:
        for name in ("images", "fg_masks", "flame_param"):
            (part / name).mkdir()
        model.save(part / "head_model.npz")
        for timestep, values in parameters.items():
            values.save(part / parameter_file(timestep), model)
        _write_canonical(part / "canonical_flame_param.npz", model, next(iter(parameters.values())))
        for split in SPLITS:
            frames = [frame for frame in capture.split(split) if frame.timestep in parameters]
            content = {
                "timestep_indices": sorted({frame.timestep for frame in frames}),
                "camera_indices": sorted({frame.camera for frame in frames}),
                "frames": [
                    {
                        **_camera_entry(frame, capture.camera(frame)),
                        **_files(frame, lambda file, name: place(capture.root / file, part, folder, name)),
                    }
                    for frame in frames
                ],
            }
            (part / INDEXES[split]).write_text(json.dumps(content, indent=1))


def parameter_file(timestep: int) -> str:
    """Name of the file of a timestep's head parameters.

    Args:
        timestep: The timestep.

    Returns:
        Path, relative to the dataset.
    """
    return f"flame_param/{timestep:05d}.npz"


def _files(frame: Frame, put: Callable[[str, str], str]) -> dict[str, str]:
    files = {"file_path": put(frame.image, f"images/{frame.name}{Path(frame.image).suffix.lower()}")}
    if frame.mask == frame.image:  # the matte is the alpha channel
        files["fg_mask_path"] = files["file_path"]
    elif frame.mask is not None:
        files["fg_mask_path"] = put(frame.mask, f"fg_masks/{frame.name}{Path(frame.mask).suffix.lower()}")
    return files


def _camera_entry(frame: Frame, camera: Camera) -> dict[str, Any]:
    return {
        "timestep_index": frame.timestep,
        "camera_index": frame.camera,
        "camera_id": f"{frame.camera:02d}",
        "sequence": frame.sequence,
        "fl_x": camera.fx,
        "fl_y": camera.fy,
        "cx": camera.cx,
        "cy": camera.cy,
        "w": camera.width,
        "h": camera.height,
        "camera_angle_x": 2 * math.atan(camera.width / (2 * camera.fx)),
        "camera_angle_y": 2 * math.atan(camera.height / (2 * camera.fy)),
        "transform_matrix": (camera.world_from_camera @ OPENCV_FROM_OPENGL).tolist(),
        "flame_param_path": parameter_file(frame.timestep),
    }


def _write_canonical(file: Path, model: HeadModel, first: HeadParameters) -> None:
    """The file by which GaussianAvatars knows a moving head: the neutral head with an open mouth."""
    neutral = replace(HeadParameters.zeros(model), shape=first.shape, static_offset=first.static_offset)
    if "jaw" in model.joint_names:
        neutral.joints[model.joint_names.index("jaw") - 1] = OPEN_JAW
    neutral.save(file, model)
