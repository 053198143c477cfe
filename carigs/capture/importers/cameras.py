"""Cameras of a calibration: a COLMAP model, or a file cameras.json.

cameras.json holds {"cameras": [{"name", "width", "height", "fx", "fy", "cx", "cy", "camera_from_world"}, ...]}: pixels,
and a 4 x 4 rigid transform to OpenCV axes (x right, y down, z forward). Cameras are pinholes: what says otherwise is
refused (`carigs.capture.calibration.keys`).
"""

from __future__ import annotations

import math
from pathlib import Path, PurePosixPath
from typing import NamedTuple

import numpy as np

from carigs.capture.calibration.camera_checks import check_intrinsics, check_rigid
from carigs.capture.calibration.keys import CAMERAS_JSON, CalibrationKeys
from carigs.capture.camera import Camera
from carigs.errors import InputError, SettingsError
from carigs.readers.arrays import checked_array
from carigs.readers.colmap import ColmapImage, read_colmap
from carigs.readers.json_files import json_field, read_json


class Calibration(NamedTuple):
    """What `read_cameras` finds."""

    cameras: dict[str, Camera]
    """By name: for COLMAP, the name of the image without suffix."""
    warnings: tuple[str, ...]
    """What was left unread although it may move pixels, one line each."""


def read_cameras(path: Path, metres_per_unit: float = 1.0) -> Calibration:
    """Read a calibration.

    Args:
        path: A COLMAP model's folder, or a file cameras.json.
        metres_per_unit: Size of the unit of translations.

    Returns:
        Cameras by name, and warnings.

    Raises:
        InputError: If a file is missing or broken, a camera cannot exist, or has lens distortion.
        SettingsError: If the unit is not a positive number.
    """
    if not 0 < metres_per_unit < math.inf:
        raise SettingsError(f"{metres_per_unit:g} metres per unit are impossible")
    keys, scaled = CalibrationKeys(CAMERAS_JSON), {}
    cameras = _read_colmap(path) if path.is_dir() else _read_json(path, keys)
    for name, camera in cameras.items():
        pose = camera.camera_from_world.copy()
        pose[:3, 3] *= metres_per_unit
        check_rigid(pose, path, f"camera {name}")
        check_intrinsics(camera, path, f"camera {name}")
        scaled[name] = Camera(pose, *camera.intrinsics, camera.width, camera.height)
    return Calibration(scaled, keys.warnings())


def _read_colmap(folder: Path) -> dict[str, Camera]:
    cameras: dict[str, Camera] = {}
    for image in read_colmap(folder):
        path = PurePosixPath(image.name.replace("\\", "/"))  # of a program on Windows
        name = path.with_suffix("").as_posix() if path.name else image.name
        if name in cameras:
            raise InputError("two images have this name", file=folder, field=name)
        cameras[name] = Camera(_pose(image, folder), *image.camera)
    return cameras


def _pose(image: ColmapImage, folder: Path) -> np.ndarray:
    """4 x 4 camera_from_world of a quaternion and a translation."""
    w, x, y, z = quaternion = np.array(image.quaternion)
    norm = math.hypot(*quaternion)  # overflows without a warning
    if not 0.9 < norm < 1.1:
        raise InputError(f"a quaternion of length {norm:g} is no rotation", file=folder, field=image.name)
    w, x, y, z = quaternion / norm
    pose = np.eye(4)
    pose[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    pose[:3, 3] = image.translation
    return pose


def _read_json(file: Path, keys: CalibrationKeys) -> dict[str, Camera]:
    cameras: dict[str, Camera] = {}
    content = read_json(file, dict)
    keys.check(content, file)
    for i, entry in enumerate(json_field(content, "cameras", list, file=file)):
        where = f"cameras[{i}]"
        if isinstance(entry, dict):
            keys.check(entry, file, where)
        name = json_field(entry, "name", str, file=file, where=where)
        name = name.replace("\\", "/")
        if name in cameras:
            raise InputError(f"two cameras are called {name[:60]}", file=file, field=f"{where}.name")
        numbers = [float(json_field(entry, key, float, file=file, where=where)) for key in ("fx", "fy", "cx", "cy")]
        size = [json_field(entry, key, int, file=file, where=where) for key in ("width", "height")]
        field = f"{where}.camera_from_world"
        rows = {field: json_field(entry, "camera_from_world", list, file=file, where=where)}
        cameras[name] = Camera(checked_array(rows, field, (4, 4), np.float64, file=file), *numbers, *size)
    if not cameras:
        raise InputError("holds no cameras", file=file, field="cameras")
    return cameras
