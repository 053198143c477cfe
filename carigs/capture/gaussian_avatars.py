"""Datasets in the folder layout of GaussianAvatars and VHAP: transforms_{train,val,test}.json and what they name."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from carigs.capture.camera import OPENCV_FROM_OPENGL, Camera
from carigs.capture.camera_checks import check_intrinsics, check_rigid
from carigs.capture.dataset import SPLITS, Capture, Frame
from carigs.capture.dataset_paths import file_inside
from carigs.errors import InputError
from carigs.head import HeadModel, HeadParameters
from carigs.readers.arrays import checked_array
from carigs.readers.images import image_size
from carigs.readers.json_files import json_field, read_json


def read_dataset(folder: Path, head_model: Path, *, background: float = 1.0) -> Capture:
    """Index a dataset and check all of it: files, image sizes, cameras and head parameters.

    Args:
        folder: The dataset. The splits `train` and `test` must have frames, `val` may be empty or missing.
        head_model: File of the head model.
        background: Grey value that the images were composited on.

    Returns:
        The capture, with frames sorted by timestep, then camera.

    Raises:
        InputError: If anything is missing or inconsistent; names file and field.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise InputError("no such dataset folder", file=folder)
    model = HeadModel.load(head_model)
    frames: list[Frame] = []
    cameras: dict[int, Camera] = {}
    for split in SPLITS:
        file = folder / f"transforms_{split}.json"
        if split == "val" and not file.exists():
            continue
        content = read_json(file, dict)
        entries = json_field(content, "frames", list, file=file)
        if not entries and split != "val":
            raise InputError(f"the {split} split is empty", file=file, field="frames")
        for i, entry in enumerate(entries):
            where = f"frames[{i}]"
            if not isinstance(entry, dict):
                raise InputError("expected an object", file=file, field=where)
            frame, camera = _read_frame(entry, content, split, file, where)
            if not _same(cameras.setdefault(frame.camera, camera), camera):
                problem = f"camera {frame.camera} differs from its earlier frames"
                raise InputError(problem, file=file, field=f"{where}.transform_matrix")
            frames.append(frame)
    _check_cameras(folder, frames, cameras)
    _check_files(folder, frames, cameras, model)
    frames.sort(key=lambda frame: (frame.timestep, frame.camera))
    return Capture(folder, Path(head_model), tuple(frames), dict(sorted(cameras.items())), background)


def _read_frame(
    entry: dict[str, Any], defaults: dict[str, Any], split: str, file: Path, where: str
) -> tuple[Frame, Camera]:
    """One entry; keys that it lacks fall back to the top level of the file."""
    values = {**defaults, **entry}

    def number(key: str, default: float | None = None) -> float:
        return float(json_field({key: default, **values}, key, float, file=file, where=where))

    def field(key: str, kind: type) -> Any:
        return json_field(entry, key, kind, file=file, where=where)

    timestep, index = (_whole(field(key, float), file, f"{where}.{key}") for key in ("timestep_index", "camera_index"))
    image, mask, parameters = (
        file_inside(field(key, str), file, f"{where}.{key}")
        for key in ("file_path", "fg_mask_path", "flame_param_path")
    )
    width, height = (_whole(number(key), file, f"{where}.{key}") for key in ("w", "h"))
    fx = number("fl_x")
    # The principal point defaults to the centre. (VHAP flips cy since November 2024, which does not matter there.)
    fy, cx, cy = number("fl_y", fx), number("cx", width / 2), number("cy", height / 2)
    camera = Camera(_read_pose(entry, file, where), fx, fy, cx, cy, width, height)
    check_intrinsics(camera, file, where)
    sequence = str(entry.get("sequence") or _sequence_of(image))
    return Frame(timestep, index, sequence, split, image, mask, parameters), camera


def _whole(value: float, file: Path, field: str) -> int:
    if value != int(value) or value < 0:
        raise InputError(f"expected a whole number, 0 or larger, found {value}", file=file, field=field)
    return int(value)


def _read_pose(entry: dict[str, Any], file: Path, where: str) -> np.ndarray:
    """camera_from_world in OpenCV axes."""
    field = f"{where}.transform_matrix"
    rows = json_field(entry, "transform_matrix", list, file=file, where=where)
    world_from_opengl = checked_array({field: rows}, field, (4, 4), np.float64, file=file)
    check_rigid(world_from_opengl, file, field)
    return OPENCV_FROM_OPENGL @ np.linalg.inv(world_from_opengl)


def _sequence_of(file_path: str) -> str:
    """Union folders name the sequence in the neighbouring folder: `../306_EMO-1_v16_.../images/...` -> EMO-1."""
    parts = Path(file_path).parts
    names = [name for part in parts for name in part.split("_") if name[:3] in ("EMO", "EXP") or name == "FREE"]
    return names[0] if names else ""


def _same(a: Camera, b: Camera) -> bool:
    return bool(np.allclose(a.camera_from_world, b.camera_from_world, atol=1e-6)) and (
        (*a.intrinsics, a.width, a.height) == (*b.intrinsics, b.width, b.height)
    )


def _check_cameras(folder: Path, frames: list[Frame], cameras: dict[int, Camera]) -> None:
    """Refuse cameras that are listed twice: two cannot stand in one place."""
    timesteps: dict[int, set[int]] = {}
    for frame in frames:
        timesteps.setdefault(frame.camera, set()).add(frame.timestep)
    first: dict[tuple[Any, ...], int] = {}
    for c, camera in cameras.items():
        key = (camera.camera_from_world.round(6).tobytes(), *camera.intrinsics, camera.width, camera.height)
        other = first.setdefault(key, c)
        if other != c and timesteps[other] & timesteps[c]:
            problem = f"cameras {other} and {c} are the same camera: equal transform_matrix and intrinsics"
            raise InputError(problem, file=folder, field="camera_index")


def _check_files(folder: Path, frames: list[Frame], cameras: dict[int, Camera], model: HeadModel) -> None:
    parameter_files: dict[int, str] = {}
    seen: set[tuple[int, int]] = set()
    images: dict[str, Frame] = {}
    for frame in frames:
        if (frame.timestep, frame.camera) in seen:
            raise InputError("timestep and camera appear twice", file=folder, field=frame.name)
        seen.add((frame.timestep, frame.camera))
        other = images.setdefault(os.path.normpath(frame.image), frame)
        if other is not frame:
            problem = f"is the image of two frames, {other.name} and {frame.name}"
            raise InputError(problem, file=folder / frame.image, field="file_path")
        camera = cameras[frame.camera]
        for name in (frame.image, frame.mask):
            width, height = image_size(folder / name)
            if (width, height) != (camera.width, camera.height):
                problem = f"{width} x {height} pixels, its camera has {camera.width} x {camera.height}"
                raise InputError(problem, file=folder / name)
        if parameter_files.setdefault(frame.timestep, frame.parameters) != frame.parameters:
            problem = f"timestep {frame.timestep} has two parameter files"
            raise InputError(problem, file=folder / frame.parameters, field="flame_param_path")
    for name in parameter_files.values():
        HeadParameters.load(folder / name, model)
