"""Writer of the folder layout of GaussianAvatars and VHAP, the inverse of `read_dataset`."""

from __future__ import annotations

import json
import math
import os
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from carigs.capture.camera import OPENCV_FROM_OPENGL, Camera
from carigs.capture.dataset import Capture
from carigs.capture.frame import SPLITS, Frame
from carigs.capture.splits import FRONTAL_CAMERA
from carigs.errors import InputError
from carigs.files import writing
from carigs.head import HeadModel, HeadParameters

TRAINED = 0.7
"""Share of the timesteps of a single sequence that are trained on; the rest is held out, as VHAP does."""
OPEN_JAW = (0.3, 0.0, 0.0)


def write_dataset(
    folder: Path, capture: Capture, model: HeadModel, parameters: Callable[[int], HeadParameters], *, link: bool = True
) -> None:
    """Write a dataset.

    Args:
        folder: Folder to write to, empty or new.
        capture: Frames and cameras.
        model: The head model.
        parameters: The head parameters of a timestep.
        link: Whether images are symbolic links to those of the capture; else they are copied.

    Raises:
        InputError: If the folder holds something.
    """
    if folder.exists() and any(folder.iterdir()):
        raise InputError("is not empty; nothing is overwritten", file=folder)
    for name in ("images", "fg_masks", "flame_param"):
        (folder / name).mkdir(parents=True, exist_ok=True)
    model.save(folder / "head_model.npz")
    place = _link if link else shutil.copyfile
    entries: dict[str, list[dict[str, Any]]] = {split: [] for split in SPLITS}
    written: set[int] = set()
    for frame in capture.frames:
        if frame.timestep not in written:
            parameters(frame.timestep).save(folder / _parameter_file(frame), model)
            written.add(frame.timestep)
        files = {"file_path": f"images/{frame.name}{Path(frame.image).suffix.lower()}"}
        place(capture.root / frame.image, folder / files["file_path"])
        if frame.mask is not None and frame.mask != frame.image:
            files["fg_mask_path"] = f"fg_masks/{frame.name}{Path(frame.mask).suffix.lower()}"
            place(capture.root / frame.mask, folder / files["fg_mask_path"])
        entries[frame.split].append({**_entry(frame, capture.camera(frame)), **files})
    _write_canonical(folder / "canonical_flame_param.npz", model, parameters(capture.frames[0].timestep))
    for split, frames in entries.items():
        with writing(folder / f"transforms_{split}.json") as part:
            part.write_text(json.dumps({"frames": frames}, indent=1))


def split_sequence(frames: list[Frame]) -> list[Frame]:
    """Divide the frames of a single sequence as VHAP does.

    Args:
        frames: The frames.

    Returns:
        The frames with their splits: the last three tenths of the timesteps are `test`; of the others, camera 8, or
        the last camera, is `val`.
    """
    timesteps, cameras = sorted({f.timestep for f in frames}), sorted({f.camera for f in frames})
    trained = set(timesteps[: max(1, min(len(timesteps) - 1, math.ceil(TRAINED * len(timesteps))))])
    held_out = FRONTAL_CAMERA if FRONTAL_CAMERA in cameras else cameras[-1]
    held_out = held_out if len(cameras) > 1 else None

    def split(frame: Frame) -> str:
        if frame.timestep not in trained:
            return "test"
        return "val" if frame.camera == held_out else "train"

    return [replace(frame, split=split(frame)) for frame in frames]


def _parameter_file(frame: Frame) -> str:
    return f"flame_param/{frame.timestep:05d}.npz"


def _entry(frame: Frame, camera: Camera) -> dict[str, Any]:
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
        "flame_param_path": _parameter_file(frame),
    }


def _write_canonical(file: Path, model: HeadModel, first: HeadParameters) -> None:
    """The file by which GaussianAvatars knows a moving head: the neutral head with an open mouth."""
    neutral = replace(HeadParameters.zeros(model), shape=first.shape, static_offset=first.static_offset)
    if "jaw" in model.joint_names:
        neutral.joints[model.joint_names.index("jaw") - 1] = OPEN_JAW
    neutral.save(file, model)


def _link(source: Path, target: Path) -> None:
    os.symlink(source.resolve(), target)
