"""Motions from head parameters: datasets of GaussianAvatars and VHAP, and results of FLAME trackers.

| program | keys that are read |
|---|---|
| GaussianAvatars, VHAP | `expr`, `rotation`, `translation`, `neck_pose`, `jaw_pose`, `eyes_pose`, `joint_rotations` |
| metrical-tracker | `exp`, `jaw`, `eyes`, `eyelids`; rotations as two rows of a matrix |
| DECA, EMOCA | `exp` or `expcode`, and `pose` or `posecode`: rotation and jaw |
| SMIRK | `expression_params`, `jaw_params`, `pose_params`, `eyelid_params` |
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from carigs.errors import InputError, SettingsError
from carigs.head import HeadModel
from carigs.head.model_arrays import FLAME_JOINTS
from carigs.head.parameters import check_angles
from carigs.motion.motion import MAX_FRAMES, Motion
from carigs.readers.arrays import checked_array
from carigs.readers.folders import listed, natural_order
from carigs.readers.npz import read_npz

FOLDERS = ("flame_param", "flame_params", "params", "")
"""Where a dataset has the files of its frames."""
EXPRESSION = ("expr", "exp", "expcode", "expression_params", "expression")
ROTATION = ("rotation", "global_pose", "pose_params")
JAW = ("jaw_pose", "jaw_params", "jaw")
WHOLE_POSE = ("posecode", "pose")
"""Rotation of the head and of the jaw, in one."""
EYELIDS = ("eyelid_params", "eyelids")
"""How far the left and the right eye are closed, from 0 to 1."""
MAX_BYTES = 2 << 30


def parameter_files(folder: Path) -> list[Path]:
    """Files of the frames of a dataset.

    Args:
        folder: The dataset, or the folder of the files.

    Returns:
        The .npz files in the order of their numbers.

    Raises:
        InputError: If there are none, or too many.
    """
    for name in FOLDERS:
        files = sorted((f for f in listed(folder / name, "*.npz") if name or f.stem[-1:].isdigit()), key=natural_order)
        if len(files) > MAX_FRAMES:
            raise InputError(f"{len(files)} frames; at most {MAX_FRAMES} are read", file=folder)
        if files:
            return files
    raise InputError("holds no head parameters (flame_param/00000.npz, ...)", file=folder)


def read_parameters(files: Sequence[Path], source: Path, fps: float, head: HeadModel | None) -> Motion:
    """Read head parameters as a motion.

    Args:
        files: One file of a sequence, or the files of its frames.
        source: What the user named, for messages.
        fps: Frames per second.
        head: Head model of the driver; None for `head_model.npz` beside the files, if there is one.

    Returns:
        The motion; the head is at rest in its first frame. Without a head model, expressions have their numbers as
        names.

    Raises:
        InputError: If a file is broken, or has no expression.
    """
    frames = [_frames(read_npz(file, "head parameter file", limit=MAX_BYTES), file, head) for file in files]
    keys = frames[0].keys()
    for file, frame in zip(files, frames, strict=True):
        if frame.keys() != keys or any(frame[key].shape[1:] != frames[0][key].shape[1:] for key in keys):
            raise InputError(f"holds other parameters than {files[0].name}", file=file)
    arrays = {key: np.concatenate([frame[key] for frame in frames]) for key in keys}
    beside = source / "head_model.npz" if source.is_dir() else source.with_name("head_model.npz")
    if head is None and beside.is_file():
        head = HeadModel.load(beside)
    count = arrays["expression"].shape[1]
    if head is not None and count > head.num_expressions:
        raise InputError(f"{count} expressions, the driver's head has {head.num_expressions}", file=source)
    names = [] if head is None else list(head.expression_names[:count])
    names += [str(i) for i in range(len(names), count)]
    expression = arrays.pop("expression")
    lids = arrays.pop("eyelids", None)
    if lids is not None:
        names, expression = [*names, "eyeBlinkLeft", "eyeBlinkRight"], np.concatenate([expression, lids], axis=1)
    rotation, translation = arrays.pop("rotation", None), arrays.pop("translation", None)
    rest = [np.zeros(3) if array is None else array[0] for array in (rotation, translation)]
    try:
        return Motion(fps, tuple(names), expression, arrays, rotation, translation, *rest)
    except SettingsError as error:
        raise InputError(str(error).removeprefix("motion: "), file=source) from error


def _frames(arrays: Mapping[str, np.ndarray], file: Path, head: HeadModel | None) -> dict[str, np.ndarray]:
    """Expression, rotations and translation of the frames of a file."""
    key = next((key for key in EXPRESSION if key in arrays), None)
    if key is None:
        raise InputError(f"holds no expression ({', '.join(EXPRESSION)})", file=file)
    expression = _rows(arrays, key, file)
    found, t = {"expression": expression}, len(expression)

    def take(keys: Sequence[str], name: str, size: int) -> np.ndarray | None:
        key = next((key for key in keys if key in arrays), None)
        if key is None:
            return None
        rows = _rows(arrays, key, file)
        if rows.shape[1] == 2 * size and size % 3 == 0 and name in ("jaw", "eyes", "neck"):
            rows = _from_matrix_rows(rows.reshape(-1, 6)).reshape(t, size)
        if rows.shape != (t, size):
            raise InputError(f"{rows.shape[0]} x {rows.shape[1]}, expected {t} x {size}", file=file, field=key)
        if name not in ("translation", "eyelids"):
            check_angles(rows.reshape(-1, 3), file, key)
        return rows

    whole = next((key for key in WHOLE_POSE if key in arrays), None)
    if whole is not None:
        rows = take([whole], whole, 6)
        found |= {"rotation": rows[:, :3], "jaw": rows[:, 3:]}
    for keys, name in (
        (ROTATION, "rotation"),
        (("translation",), "translation"),
        (("neck_pose", "neck"), "neck"),
        (JAW, "jaw"),
    ):
        if (rows := take(keys, name, 3)) is not None:
            found[name] = rows
    if (eyes := take(("eyes_pose", "eyes"), "eyes", 6)) is not None:
        found |= {"left_eye": eyes[:, :3], "right_eye": eyes[:, 3:]}
    if (lids := take(EYELIDS, "eyelids", 2)) is not None:
        found["eyelids"] = lids
    if "joint_rotations" in arrays:
        rows = checked_array(arrays, "joint_rotations", None, np.float64, file=file)
        names = FLAME_JOINTS[1:] if head is None else head.joint_names[1:]
        if rows.size != t * 3 * len(names):
            raise InputError(
                f"{rows.size} numbers, expected 3 for {len(names)} joints", file=file, field="joint_rotations"
            )
        check_angles(rows.reshape(-1, 3), file, "joint_rotations")
        found |= dict(zip(names, rows.reshape(t, len(names), 3).transpose(1, 0, 2), strict=True))
    return found


def _rows(arrays: Mapping[str, np.ndarray], key: str, file: Path) -> Float[np.ndarray, "t n"]:
    array = checked_array(arrays, key, None, np.float64, file=file)
    if array.size == 0:
        raise InputError("is empty", file=file, field=key)
    return array.reshape(1, -1) if array.ndim < 2 else array.reshape(len(array), -1)


def _from_matrix_rows(rows: Float[np.ndarray, "n 6"]) -> Float[np.ndarray, "n 3"]:
    """Rotation vectors from two rows of a matrix (Zhou et al. 2019), made orthogonal."""
    first = rows[:, :3] / np.maximum(np.linalg.norm(rows[:, :3], axis=1, keepdims=True), 1e-9)
    second = rows[:, 3:] - (rows[:, 3:] * first).sum(axis=1, keepdims=True) * first
    second /= np.maximum(np.linalg.norm(second, axis=1, keepdims=True), 1e-9)
    return Rotation.from_matrix(np.stack([first, second, np.cross(first, second)], axis=1)).as_rotvec()
