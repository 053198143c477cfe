"""A fitted video as a dataset in the layout of GaussianAvatars. Images stay where they are."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from carigs.capture import OPENCV_FROM_OPENGL, Capture, Frame
from carigs.capture.dataset_paths import file_inside
from carigs.capture.frame import SPLITS
from carigs.errors import InputError
from carigs.files import writing_folder
from carigs.fitting.footage import parameter_file
from carigs.head import HeadModel, HeadParameters, flame_joints
from carigs.head.model_arrays import FLAME_JOINTS

OPEN_JAW = (0.3, 0.0, 0.0)
"""Rotation of the jaw in `canonical_flame_param.npz`, as VHAP writes it."""


def check_target(folder: Path, capture: Capture) -> None:
    """Refuse a folder whose contents would be lost.

    Args:
        folder: The folder that a dataset is to be written to.
        capture: The footage.

    Raises:
        InputError: If the folder exists and is no dataset, or if it holds the footage.
    """
    folder = Path(os.path.abspath(folder))
    if capture.root.resolve().is_relative_to(folder.resolve()):
        raise InputError("the footage lies in this folder; give another folder", file=folder)
    if folder.exists() and not (folder / "canonical_flame_param.npz").exists():
        raise InputError("exists and is no dataset; give another folder", file=folder)


def write_dataset(folder: Path, capture: Capture, model: HeadModel, parameters: Mapping[int, HeadParameters]) -> None:
    """Write indexes and head parameters; refer to images beside the dataset, and link those that lie elsewhere.

    Args:
        folder: Folder to create.
        capture: The footage.
        model: The head model.
        parameters: Head parameters by timestep; frames of other timesteps are left out.

    Raises:
        InputError: As `check_target`.
    """
    check_target(folder, capture)
    folder = Path(os.path.abspath(folder))
    with writing_folder(folder) as part:
        (part / "flame_param").mkdir()
        for timestep, values in parameters.items():
            values.save(part / parameter_file(timestep), model)
        first = next(iter(parameters.values()))
        canonical = replace(HeadParameters.zeros(model), shape=first.shape, static_offset=first.static_offset)
        if model.joint_names == FLAME_JOINTS:
            canonical = replace(canonical, joints=flame_joints(jaw=OPEN_JAW))
        canonical.save(part / "canonical_flame_param.npz", model)
        for split in SPLITS:
            frames = [frame for frame in capture.split(split) if frame.timestep in parameters]
            content = {
                "timestep_indices": sorted({frame.timestep for frame in frames}),
                "camera_indices": sorted({frame.camera for frame in frames}),
                "frames": [_entry(frame, capture, folder, part) for frame in frames],
            }
            (part / f"transforms_{split}.json").write_text(json.dumps(content, indent=1))


def _entry(frame: Frame, capture: Capture, folder: Path, part: Path) -> dict[str, Any]:
    camera = capture.camera(frame)
    entry = {
        "timestep_index": frame.timestep,
        "camera_index": frame.camera,
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
        "file_path": _reference(capture.root / frame.image, "images", frame, folder, part),
        "flame_param_path": frame.parameters,
    }
    if frame.mask == frame.image:
        entry["fg_mask_path"] = entry["file_path"]
    elif frame.mask is not None:
        entry["fg_mask_path"] = _reference(capture.root / frame.mask, "fg_masks", frame, folder, part)
    return entry


def _reference(file: Path, kind: str, frame: Frame, folder: Path, part: Path) -> str:
    """Relative path of a file beside the dataset, or of a link to it."""
    name = os.path.relpath(os.path.abspath(file), folder)
    try:
        return file_inside(name, folder, kind)
    except InputError:
        name = f"{kind}/{frame.name}{file.suffix}"
        (part / kind).mkdir(exist_ok=True)
        (part / name).symlink_to(file.resolve())
        return name
