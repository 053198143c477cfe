"""FLAME parameters of trackers: VHAP's result, or one npz per timestep in the keys of GaussianAvatars.

The keys of metrical-tracker are read as well: `exp`, `shape`, `jaw` and `eyes`, rotations as two rows of a matrix. It
moves the camera and not the head: `R`, `t` and `K` are OpenCV's extrinsics and intrinsics of each frame.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from carigs.capture.calibration.camera_checks import check_intrinsics, check_rigid
from carigs.capture.calibration.keys import refuse_distortion
from carigs.capture.camera import Camera
from carigs.capture.capture_json import MAX_NUMBER
from carigs.capture.importers.images import FoundImage, stated_timestep
from carigs.errors import InputError
from carigs.head import HeadModel, HeadParameters, flame_joints
from carigs.readers.arrays import checked_array
from carigs.readers.folders import listed
from carigs.readers.images import read_header
from carigs.readers.npz import read_npz

PER_FRAME = {"rotation": 3, "translation": 3, "neck_pose": 3, "jaw_pose": 3, "eyes_pose": 6, "expr": None}
"""Arrays of VHAP's result with one row per frame, and their columns."""
SHORTEST = 1e-9
"""Rows of a rotation that are shorter have no direction."""


def read_flame_track(path: Path, model: HeadModel) -> dict[int, HeadParameters]:
    """Read FLAME parameters of a sequence.

    Args:
        path: VHAP's `tracked_flame_params_*.npz`, or a folder of npz files whose names end with their timesteps.
        model: The head model.

    Returns:
        Parameters by timestep: the numbers in `timestep_id` of VHAP, or else 0, 1, 2, ...

    Raises:
        InputError: If a file is missing or broken, or does not fit the model.
    """
    if not path.is_dir():
        return _read_vhap(path, model)
    return {t: _read_frame(file, model) for t, file in _files(path).items()}


def read_tracked_cameras(folder: Path, images: list[FoundImage]) -> dict[int, Camera]:
    """Read the camera of each frame of metrical-tracker's npz files.

    Args:
        folder: npz files whose names end with their timesteps.
        images: Images of one camera, whose sizes are the cameras'.

    Returns:
        Cameras by timestep; none if the files hold no cameras.

    Raises:
        InputError: If an array is missing or broken, or there are several cameras, or one has lens distortion.
    """
    files, cameras = _files(folder), {}
    for image in images:
        file = files.get(image.timestep)
        arrays = read_npz(file) if file is not None else {}
        if "K" not in arrays:
            continue
        if image.timestep in cameras:
            raise InputError("a tracker of one camera cannot place the others", file=image.file)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = _squeezed(arrays, "R", (3, 3), file), _squeezed(arrays, "t", (3,), file)
        k, header = _squeezed(arrays, "K", (3, 3), file), read_header(image.file)
        if (k[[0, 1, 2, 2, 2], [1, 0, 0, 1, 2]] != [0, 0, 0, 0, 1]).any():
            raise InputError("expected fx 0 cx, 0 fy cy, 0 0 1: a camera without skew", file=file, field="K")
        for key in arrays.keys() - {"R", "t", "K"}:
            refuse_distortion(key, arrays[key].tolist(), file)
        size = (header.width, header.height)
        if "img_size" in arrays:  # height, width
            size = tuple(map(int, checked_array(arrays, "img_size", (2,), np.int64, file=file)[::-1]))
        check_rigid(pose, file, "R")
        camera = Camera(pose, *map(float, (k[0, 0], k[1, 1], k[0, 2], k[1, 2])), *size)
        check_intrinsics(camera, file, "K")
        cameras[image.timestep] = camera
    return cameras


def _files(folder: Path) -> dict[int, Path]:
    """Parameter files by timestep."""
    files: dict[int, Path] = {}
    for file in listed(folder, "*.npz"):
        number = re.search(r"\d+$", file.stem)
        timestep = stated_timestep(number[0]) if number else None
        if timestep is None or timestep in files:
            raise InputError("the names of parameter files end with different numbers, their timesteps", file=file)
        files[timestep] = file
    if not files:
        raise InputError("holds no .npz files", file=folder)
    return dict(sorted(files.items()))


def _read_frame(file: Path, model: HeadModel) -> HeadParameters:
    arrays = read_npz(file, "head parameter file")
    if "exp" not in arrays:
        return HeadParameters.load(file, model)
    joints = [_rotation_vector(_squeezed(arrays, "jaw", (6,), file), file, "jaw")]
    joints += [_rotation_vector(eye, file, "eyes") for eye in _squeezed(arrays, "eyes", (12,), file).reshape(2, 6)]
    return HeadParameters(
        joints=flame_joints(jaw=joints[0], left_eye=joints[1], right_eye=joints[2]),
        shape=_padded(arrays, "shape", model.num_identity, file),
        expression=_padded(arrays, "exp", model.num_expressions, file),
    )


def rotation_vector_of_rows(rows: Float[np.ndarray, "6"]) -> Float[np.ndarray, "3"]:
    """Rotation vector of the continuous representation by six numbers (Zhou et al. 2019), as PyTorch3D stores it.

    Args:
        rows: The first two rows of a rotation matrix, up to scale and skew.

    Returns:
        The rotation vector in radians.

    Raises:
        ValueError: If the rows are too short, or parallel.
    """
    first, second = _unit(rows[:3]), rows[3:]
    second = _unit(second - (first @ second) * first)
    return Rotation.from_matrix(np.stack([first, second, np.cross(first, second)])).as_rotvec()


def _unit(row: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    with np.errstate(over="ignore"):
        length = np.linalg.norm(row)
    if not SHORTEST < length < np.inf:
        raise ValueError("no rotation: a row is 0, or both are parallel")
    return row / length


def _rotation_vector(rows: Float[np.ndarray, "6"], file: Path, field: str) -> Float[np.ndarray, "3"]:
    try:
        return rotation_vector_of_rows(rows)
    except ValueError as error:
        raise InputError(str(error), file=file, field=field) from error


def _squeezed(arrays: Mapping[str, np.ndarray], key: str, shape: tuple[int, ...], file: Path) -> np.ndarray:
    """An array, with or without a leading axis of one frame."""
    array = checked_array(arrays, key, None, np.float64, file=file)
    if array.size != math.prod(shape):
        raise InputError(f"{array.size} values, expected {math.prod(shape)}", file=file, field=key)
    return array.reshape(shape)


def _padded(arrays: Mapping[str, np.ndarray], key: str, size: int, file: Path) -> np.ndarray:
    values = checked_array(arrays, key, None, np.float64, file=file).reshape(-1)
    if values.size > size:
        raise InputError(f"{values.size} values, expected at most {size}", file=file, field=key)
    return np.pad(values, (0, size - values.size))


def _read_vhap(file: Path, model: HeadModel) -> dict[int, HeadParameters]:
    arrays = read_npz(file, "result of a tracker", required=(*PER_FRAME, "shape"))
    count = len(np.atleast_1d(arrays["expr"]))
    for key, columns in PER_FRAME.items():
        checked_array(arrays, key, (count, columns), np.float64, file=file)
    shared = {key: arrays[key] for key in ("shape", "static_offset") if key in arrays}
    moving = [*PER_FRAME, *(["dynamic_offset"] if "dynamic_offset" in arrays else [])]
    if (rows := len(np.atleast_1d(arrays[moving[-1]]))) != count:
        raise InputError(f"{rows} rows, expected {count}", file=file, field=moving[-1])
    return {
        t: HeadParameters.from_arrays({**shared, **{key: arrays[key][i : i + 1] for key in moving}}, model, file)
        for i, t in enumerate(_timesteps(arrays, count, file))
    }


def _timesteps(arrays: Mapping[str, np.ndarray], count: int, file: Path) -> list[int]:
    if "timestep_id" not in arrays:
        return list(range(count))
    numbers = [stated_timestep(str(name)) for name in np.atleast_1d(arrays["timestep_id"]).ravel()]
    timesteps = [number for number in numbers if number is not None]
    if len(numbers) != count or len(set(timesteps)) < count:
        problem = f"expected {count} different numbers up to {MAX_NUMBER}"
        raise InputError(problem, file=file, field="timestep_id")
    return timesteps
