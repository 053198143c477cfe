"""Datasets in the folder layout of GaussianAvatars and VHAP: transforms_{train,val,test}.json and what they name."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from carigs.capture.camera import OPENCV_FROM_OPENGL, Camera
from carigs.capture.dataset import SPLITS, Capture, Frame, read_json
from carigs.capture.images import png_size
from carigs.errors import InputError
from carigs.head import HeadModel, HeadParameters

REQUIRED = ("timestep_index", "camera_index", "transform_matrix", "file_path", "fg_mask_path", "flame_param_path")


def read_dataset(folder: Path, head_model: Path, *, background: float = 1.0) -> Capture:
    """Index a dataset and check all of it before any work starts: files, image sizes, cameras, head parameters.

    `val` may be empty; `train` and `test` may not.  Raises `InputError` naming file and field.
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
        content = read_json(file)
        entries = content.get("frames") if isinstance(content, dict) else None
        if not isinstance(entries, list):
            raise InputError("expected an object with a list of frames", file=file, field="frames")
        if not entries and split != "val":
            raise InputError(f"the {split} split is empty", file=file, field="frames")
        for i, entry in enumerate(entries):
            frame, camera = _frame(entry, content, split, file, f"frames[{i}]")
            known = cameras.setdefault(frame.camera, camera)
            if not _same(known, camera):
                raise InputError(
                    f"camera {frame.camera} differs from its earlier frames",
                    file=file,
                    field=f"frames[{i}].transform_matrix",
                )
            frames.append(frame)
    _check_files(folder, frames, cameras, model)
    frames.sort(key=lambda frame: (frame.timestep, frame.camera))
    return Capture(
        root=folder,
        head_model=Path(head_model),
        frames=tuple(frames),
        cameras=dict(sorted(cameras.items())),
        background=background,
    )


def _frame(entry: Any, shared: dict[str, Any], split: str, file: Path, where: str) -> tuple[Frame, Camera]:
    """One entry; intrinsics fall back to the copies at the top level of the file."""
    if not isinstance(entry, dict):
        raise InputError("expected an object", file=file, field=where)
    for key in REQUIRED:
        if key not in entry:
            raise InputError("this key is missing", file=file, field=f"{where}.{key}")

    def number(key: str) -> float:
        value = entry.get(key, shared.get(key))
        if isinstance(value, bool) or not isinstance(value, int | float) or not np.isfinite(value):
            raise InputError(f"expected a number, found {value!r}", file=file, field=f"{where}.{key}")
        return float(value)

    width, height, fx = int(number("w")), int(number("h")), number("fl_x")
    if width <= 0 or height <= 0 or fx <= 0:
        raise InputError("width, height and focal length must be positive", file=file, field=f"{where}.w, h, fl_x")
    try:
        world_from_opengl = np.array(entry["transform_matrix"], np.float64)
    except (TypeError, ValueError) as error:
        raise InputError("expected 4 x 4 numbers", file=file, field=f"{where}.transform_matrix") from error
    rotation = world_from_opengl[:3, :3] if world_from_opengl.shape == (4, 4) else np.zeros((3, 3))
    if not np.isfinite(world_from_opengl).all() or np.abs(rotation.T @ rotation - np.eye(3)).max() > 1e-3:
        raise InputError("expected a 4 x 4 rigid transform", file=file, field=f"{where}.transform_matrix")
    camera_from_world = OPENCV_FROM_OPENGL @ np.linalg.inv(world_from_opengl)
    camera = Camera(
        camera_from_world=camera_from_world,
        fx=fx,
        fy=number("fl_y") if "fl_y" in entry or "fl_y" in shared else fx,
        # A centred principal point where none is given.  (VHAP flips cy since November 2024; centred ones do not care.)
        cx=number("cx") if "cx" in entry or "cx" in shared else width / 2,
        cy=number("cy") if "cy" in entry or "cy" in shared else height / 2,
        width=width,
        height=height,
    )
    frame = Frame(
        timestep=int(number("timestep_index")),
        camera=int(number("camera_index")),
        sequence=str(entry.get("sequence") or _sequence_of(str(entry["file_path"]))),
        split=split,
        image=str(entry["file_path"]),
        mask=str(entry["fg_mask_path"]),
        parameters=str(entry["flame_param_path"]),
    )
    return frame, camera


def _sequence_of(file_path: str) -> str:
    """Union folders name the sequence in the neighbouring folder: `../306_EMO-1_v16_.../images/...` -> EMO-1."""
    parts = Path(file_path).parts
    names = [name for part in parts for name in part.split("_") if name[:3] in ("EMO", "EXP") or name == "FREE"]
    return names[0] if names else ""


def _same(a: Camera, b: Camera) -> bool:
    return bool(np.allclose(a.camera_from_world, b.camera_from_world, atol=1e-6)) and (
        (a.fx, a.fy, a.cx, a.cy, a.width, a.height) == (b.fx, b.fy, b.cx, b.cy, b.width, b.height)
    )


def _check_files(folder: Path, frames: list[Frame], cameras: dict[int, Camera], model: HeadModel) -> None:
    parameter_files: dict[int, str] = {}
    seen: set[tuple[int, int]] = set()
    for frame in frames:
        if (frame.timestep, frame.camera) in seen:
            raise InputError("timestep and camera appear twice", file=folder, field=frame.name)
        seen.add((frame.timestep, frame.camera))
        camera = cameras[frame.camera]
        for name in (frame.image, frame.mask):
            size = png_size(folder / name)
            if size != (camera.width, camera.height):
                raise InputError(
                    f"{size[0]} x {size[1]} pixels, its camera has {camera.width} x {camera.height}", file=folder / name
                )
        if parameter_files.setdefault(frame.timestep, frame.parameters) != frame.parameters:
            raise InputError(
                f"timestep {frame.timestep} has two parameter files",
                file=folder / frame.parameters,
                field="flame_param_path",
            )
    for name in parameter_files.values():
        HeadParameters.load(folder / name, model)
