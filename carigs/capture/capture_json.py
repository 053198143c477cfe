"""Frames and cameras in capture.json.

Each distinct camera is stored once, and so are the sequence and the parameter file of a timestep: an index of 32 000
frames has 8 MB.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from carigs.capture.calibration.camera_checks import check_intrinsics, check_rigid
from carigs.capture.camera import Camera
from carigs.capture.corrections.halo import Halo
from carigs.capture.frame import Frame
from carigs.errors import InputError
from carigs.readers.arrays import checked_array
from carigs.readers.file_names import SPLITS
from carigs.readers.json_files import json_field
from carigs.readers.limits import MAX_IMAGE_PIXELS

MAX_NUMBER = 1_000_000_000
"""Largest number of a timestep or camera."""
MAX_GAIN = 100.0
"""Largest factor on the light of an image; its inverse is the smallest."""


def cameras_to_json(cameras: Sequence[Camera]) -> list[dict[str, Any]]:
    """Distinct cameras as lists and numbers.

    Args:
        cameras: The cameras.

    Returns:
        One object per camera.
    """
    return [camera_to_json(camera) for camera in cameras]


def camera_to_json(camera: Camera) -> dict[str, Any]:
    """A camera as a list and numbers.

    Args:
        camera: The camera.

    Returns:
        Its fields.
    """
    return {**asdict(camera), "camera_from_world": camera.camera_from_world.tolist()}


def cameras_from_json(entries: list[Any], file: Path) -> tuple[Camera, ...]:
    """The inverse of `cameras_to_json`, with checks.

    Args:
        entries: The field `cameras` of the index.
        file: The index, for messages.

    Returns:
        The cameras.

    Raises:
        InputError: If a camera cannot exist.
    """
    return tuple(camera_from_json(entry, f"cameras[{i}]", file) for i, entry in enumerate(entries))


def frames_to_json(frames: Sequence[Frame]) -> dict[str, Any]:
    """Timesteps and frames as lists and objects.

    Args:
        frames: The frames.

    Returns:
        The fields `timesteps` and `frames` of the index.
    """
    timesteps = {str(f.timestep): {"sequence": f.sequence, "parameters": f.parameters} for f in frames}
    keys = ("timestep", "camera", "calibration", "split", "image", "mask")
    entries = [{key: getattr(frame, key) for key in keys} for frame in frames]
    for frame, entry in zip(frames, entries, strict=True):
        if frame.gains is not None:
            entry["gains"] = list(frame.gains)
        if frame.halo is not None:
            entry["halo"] = {"colour": list(frame.halo.colour), "photograph": frame.halo.photograph}
        if frame.remade:
            entry["remade"] = True
    return {"timesteps": timesteps, "frames": entries}


def frames_from_json(content: dict[str, Any], file: Path, num_cameras: int) -> tuple[Frame, ...]:
    """The inverse of `frames_to_json`, with checks.

    Args:
        content: The index.
        file: Its file, for messages.
        num_cameras: Number of distinct cameras.

    Returns:
        The frames.

    Raises:
        InputError: If a value is missing, of another type or not possible, or a timestep and camera appear twice.
    """
    timesteps = {
        number: [json_field(entry, key, str, file=file, where=f"timesteps.{number[:20]}") for key in _TIMESTEP_KEYS]
        for number, entry in json_field(content, "timesteps", dict, file=file).items()
    }
    frames, seen = [], set()
    for i, entry in enumerate(json_field(content, "frames", list, file=file)):
        frame = _frame(entry, f"frames[{i}]", file, timesteps, num_cameras)
        if (frame.timestep, frame.camera) in seen:
            raise InputError("timestep and camera appear twice", file=file, field=f"frames[{i}]")
        seen.add((frame.timestep, frame.camera))
        frames.append(frame)
    return tuple(frames)


_TIMESTEP_KEYS = ("sequence", "parameters")


def camera_from_json(entry: Any, where: str, file: Path) -> Camera:
    """The inverse of `camera_to_json`, with the checks that kernels rely on: a rigid transform, positive sizes.

    Args:
        entry: The fields of the camera.
        where: Their position in the file, for messages.
        file: The file, for messages.

    Returns:
        The camera.

    Raises:
        InputError: If the camera cannot exist.
    """
    fx, fy, cx, cy = (float(json_field(entry, key, float, file=file, where=where)) for key in ("fx", "fy", "cx", "cy"))
    width, height = (json_field(entry, key, int, file=file, where=where) for key in ("width", "height"))
    if not (width > 0 and height > 0 and width * height <= MAX_IMAGE_PIXELS):
        raise InputError(f"{width} x {height} pixels are impossible", file=file, field=where)
    field = f"{where}.camera_from_world"
    rows = {field: json_field(entry, "camera_from_world", list, file=file, where=where)}
    pose = checked_array(rows, field, (4, 4), np.float64, file=file)
    check_rigid(pose, file, field)
    camera = Camera(pose, fx, fy, cx, cy, width, height)
    check_intrinsics(camera, file, where)
    return camera


def _frame(entry: Any, where: str, file: Path, timesteps: dict[str, list[str]], num_cameras: int) -> Frame:
    kinds = {"timestep": int, "camera": int, "calibration": int, "split": str, "image": str, "mask": str}
    if isinstance(entry, dict) and "mask" in entry and entry["mask"] is None:
        del kinds["mask"]
    values = {key: json_field(entry, key, kind, file=file, where=where) for key, kind in kinds.items()}
    for key, limit in (("timestep", MAX_NUMBER), ("camera", MAX_NUMBER), ("calibration", num_cameras - 1)):
        if not 0 <= values[key] <= limit:
            raise InputError(f"{values[key]} is not in 0..{limit}", file=file, field=f"{where}.{key}")
    if values["split"] not in SPLITS:
        problem = f"{values['split'][:60]} is unknown; known: {', '.join(SPLITS)}"
        raise InputError(problem, file=file, field=f"{where}.split")
    if str(values["timestep"]) not in timesteps:
        raise InputError(f"there is no timestep {values['timestep']}", file=file, field=f"{where}.timestep")
    if "gains" in entry:
        field = f"{where}.gains"
        rows = {field: json_field(entry, "gains", list, file=file, where=where)}
        gains = checked_array(rows, field, (3,), np.float64, within=(1 / MAX_GAIN, MAX_GAIN), file=file)
        values["gains"] = tuple(gains.tolist())
    if "halo" in entry:
        field = f"{where}.halo"
        halo = json_field(entry, "halo", dict, file=file, where=where)
        rows = {field: json_field(halo, "colour", list, file=file, where=field)}
        colour = checked_array(rows, field, (3,), np.float64, within=(0, 1), file=file)
        photograph = json_field(halo, "photograph", bool, file=file, where=field)
        values["halo"] = Halo(tuple(colour.tolist()), photograph)
    if "remade" in entry:
        values["remade"] = json_field(entry, "remade", bool, file=file, where=where)
    return Frame(
        **{"mask": None, **values}, **dict(zip(_TIMESTEP_KEYS, timesteps[str(values["timestep"])], strict=True))
    )
