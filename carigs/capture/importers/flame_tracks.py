"""FLAME parameters of trackers: VHAP's result, or one npz per timestep in the keys of GaussianAvatars."""

from __future__ import annotations

import re
import tempfile
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from carigs.errors import InputError
from carigs.head import HeadModel, HeadParameters
from carigs.readers.arrays import checked_array
from carigs.readers.npz import read_npz

PER_FRAME = {"rotation": 3, "translation": 3, "neck_pose": 3, "jaw_pose": 3, "eyes_pose": 6, "expr": None}
"""Arrays of VHAP's result with one row per frame, and their columns."""


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
    parameters = {}
    for file in sorted(path.glob("*.npz")):
        number = re.search(r"\d+$", file.stem)
        if number is None or int(number[0]) in parameters:
            raise InputError("the names of parameter files end with different numbers, their timesteps", file=file)
        parameters[int(number[0])] = HeadParameters.load(file, model)
    if not parameters:
        raise InputError("holds no .npz files", file=path)
    return dict(sorted(parameters.items()))


def _read_vhap(file: Path, model: HeadModel) -> dict[int, HeadParameters]:
    arrays = read_npz(file, "result of a tracker", required=(*PER_FRAME, "shape"))
    count = len(np.atleast_1d(arrays["expr"]))
    for key, columns in PER_FRAME.items():
        checked_array(arrays, key, (count, columns), np.float64, file=file)
    shared = {key: arrays[key] for key in ("shape", "static_offset") if key in arrays}
    moving = [*PER_FRAME, *(["dynamic_offset"] if "dynamic_offset" in arrays else [])]
    if len(arrays[moving[-1]]) != count:
        raise InputError(f"{len(arrays[moving[-1]])} rows, expected {count}", file=file, field=moving[-1])
    with tempfile.TemporaryDirectory() as folder:  # one frame has a reader already
        frame = Path(folder) / file.name
        parameters = {}
        for i, t in enumerate(_timesteps(arrays, count, file)):
            np.savez(frame, **shared, **{key: arrays[key][i : i + 1] for key in moving})
            try:
                parameters[t] = HeadParameters.load(frame, model)
            except InputError as error:
                raise InputError(error.problem, file=file, field=error.field) from error
    return parameters


def _timesteps(arrays: Mapping[str, np.ndarray], count: int, file: Path) -> list[int]:
    if "timestep_id" not in arrays:
        return list(range(count))
    names = [str(name) for name in np.atleast_1d(arrays["timestep_id"])]
    if len(names) != count or not all(name.isdecimal() for name in names) or len({int(n) for n in names}) < count:
        raise InputError(f"expected {count} different numbers", file=file, field="timestep_id")
    return [int(name) for name in names]
