"""The head and its motion in an avatar's file: arrays of the head model, parameters of every timestep."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from carigs.errors import InputError
from carigs.head import HeadModel, HeadParameters
from carigs.head.model_arrays import POSSIBLE, checked_fields
from carigs.head.parameters import check_angles
from carigs.readers.arrays import checked_array
from carigs.readers.limits import max_unpacked_bytes

PREFIX = "head_"
POSE = ("translation", "rotation", "joints", "expression")
"""Fields of `HeadParameters` that the file holds for every timestep."""
MAX_BLENDSHAPES = 2000
"""Most blendshapes of a head; FLAME has 400."""
MAX_BASIS_BYTES, BASIS_EXPANSION = 1 << 30, 40
"""Of a basis with its zeros, and for each byte that is stored: of ICT-FaceKit 53 of 400 blendshapes are."""
MAX_TIMESTEPS = 100_000
MAX_COEFFICIENT = 1e4
"""Largest coefficient of an expression, without its sign."""
POSE_RANGES = {"translation": POSSIBLE, "expression": (-MAX_COEFFICIENT, MAX_COEFFICIENT)}
BASES = ("shapedirs", "joint_basis")
"""Arrays with one column for each blendshape."""


def head_to_arrays(head: HeadModel) -> dict[str, np.ndarray]:
    """Arrays of a head; of the blendshapes only the expressions that move anything.

    Args:
        head: Head model with the identity in its template.

    Returns:
        Arrays by name.
    """
    moves = head.shapedirs.any(axis=(0, 1)) | head.joint_basis.any(axis=(0, 1))
    columns = head.num_identity + np.flatnonzero(moves[head.num_identity :])
    arrays = head.arrays()
    arrays |= {name: arrays[name][:, :, columns] for name in BASES if name in arrays}
    arrays |= {"columns": columns, "blendshapes": np.array(len(moves))}
    return {f"{PREFIX}{name}": array for name, array in arrays.items()}


def head_of(arrays: Mapping[str, np.ndarray], file: Path) -> HeadModel:
    """Build the head from the arrays of `head_to_arrays`.

    Args:
        arrays: Arrays by name.
        file: Where they come from, for messages.

    Returns:
        The head model.

    Raises:
        InputError: If an array is missing, of another shape or kind, or holds a value that is not possible.
    """
    head = {name: array for name, array in arrays.items() if name.startswith(PREFIX)}
    blendshapes = int(checked_array(head, f"{PREFIX}blendshapes", (), np.int64, file=file))
    if not 0 < blendshapes <= MAX_BLENDSHAPES:
        raise InputError(f"{blendshapes} are impossible", file=file, field=f"{PREFIX}blendshapes")
    columns = checked_array(head, f"{PREFIX}columns", (None,), np.int64, below=blendshapes, file=file)
    if len(np.unique(columns)) < len(columns):
        raise InputError("an index appears twice", file=file, field=f"{PREFIX}columns")
    for name in (f"{PREFIX}{name}" for name in BASES):
        if name in head:
            used = checked_array(head, name, (None, 3, len(columns)), np.float32, file=file)
            size = 4 * 3 * len(used) * blendshapes
            if size > min(MAX_BASIS_BYTES, max_unpacked_bytes(used.nbytes, BASIS_EXPANSION)):
                problem = f"{len(columns)} of {blendshapes} blendshapes are stored, but all would take {size:.2g} bytes"
                raise InputError(problem, file=file, field=f"{PREFIX}blendshapes")
            head[name] = np.zeros((*used.shape[:2], blendshapes), np.float32)
            head[name][:, :, columns] = used
    return HeadModel(**checked_fields(head, file, PREFIX))


def parameters_to_arrays(parameters: Mapping[int, HeadParameters]) -> dict[str, Any]:
    """Arrays of the parameters over time.

    Args:
        parameters: Parameters of every timestep, without shape and static offset.

    Returns:
        Arrays by name, in the order of the timesteps.
    """
    timesteps = sorted(parameters)
    frames = [parameters[t] for t in timesteps]
    arrays: dict[str, Any] = {"timesteps": np.array(timesteps)}
    arrays |= {f"pose_{name}": np.stack([getattr(frame, name) for frame in frames]) for name in POSE}
    moved = [t for t in timesteps if parameters[t].dynamic_offset is not None]
    if moved:
        arrays["offset_timesteps"] = np.array(moved)
        arrays["offset_dynamic"] = np.stack([parameters[t].dynamic_offset for t in moved]).astype(np.float32)
    return arrays


def parameters_from_arrays(arrays: Mapping[str, np.ndarray], head: HeadModel, file: Path) -> dict[int, HeadParameters]:
    """Read the parameters over time from the arrays of `parameters_to_arrays`.

    Args:
        arrays: Arrays by name.
        head: The head model.
        file: Where they come from, for messages.

    Returns:
        Parameters of every timestep, without shape and static offset.

    Raises:
        InputError: If an array is missing, of another shape or kind, or holds a value that is not possible.
    """

    def take(name: str, shape: tuple[int | None, ...], dtype: Any, **limits: Any) -> np.ndarray:
        return checked_array(arrays, name, shape, dtype, **limits, file=file)

    timesteps = take("timesteps", (None,), np.int64)
    if len(timesteps) == 0 or len(np.unique(timesteps)) < len(timesteps) or timesteps.min() < 0:
        raise InputError("expected one or more different timesteps", file=file, field="timesteps")
    if len(timesteps) > MAX_TIMESTEPS:
        raise InputError(f"{len(timesteps)} timesteps; at most {MAX_TIMESTEPS} are read", file=file, field="timesteps")
    zeros, fields = HeadParameters.zeros(head), {}
    for name in POSE:
        shape = (len(timesteps), *getattr(zeros, name).shape)
        fields[name] = take(f"pose_{name}", shape, np.float64, within=POSE_RANGES.get(name))
        if name in ("rotation", "joints"):
            check_angles(fields[name], file, f"pose_{name}")
    offsets: dict[int, np.ndarray] = {}
    if "offset_timesteps" in arrays:
        moved = take("offset_timesteps", (None,), np.int64)
        offset = take("offset_dynamic", (len(moved), len(head.v_template), 3), np.float32, within=POSSIBLE)
        offsets = dict(zip(moved.tolist(), offset, strict=True))
        if len(offsets) < len(moved) or not set(offsets) <= set(timesteps.tolist()):
            raise InputError("expected different timesteps of the head", file=file, field="offset_timesteps")
    return {
        t: HeadParameters(**{name: fields[name][i] for name in POSE}, shape=zeros.shape, dynamic_offset=offsets.get(t))
        for i, t in enumerate(timesteps.tolist())
    }
