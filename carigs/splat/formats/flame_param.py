"""Head parameters of all timesteps in one file: `flame_param.npz` of GaussianAvatars and SurFhead.

Files of VHAP (`tracked_flame_params_*.npz`) have the same arrays. `dynamic_offset` is ignored, as in both programs.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from carigs.errors import InputError
from carigs.head import HeadModel, HeadParameters
from carigs.head.model_arrays import FLAME_JOINTS
from carigs.head.parameters import FLAME_KEYS, check_angles
from carigs.readers.arrays import checked_array
from carigs.readers.npz import read_npz
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.system.files import writing

PER_TIMESTEP = ("translation", "rotation", *FLAME_KEYS, "joint_rotations", "expr")
"""Arrays with a row per timestep. The others, `shape` and `static_offset`, belong to the subject."""


def read_flame_param(file: Path, model: HeadModel) -> dict[int, HeadParameters]:
    """Read the parameters of all timesteps.

    Args:
        file: The .npz file.
        model: The head model.

    Returns:
        Parameters by timestep, from 0.

    Raises:
        InputError: If the file is missing or cannot be read, or an array is missing, not finite, of a shape that does
            not fit the model, or of another number of timesteps.
    """
    arrays = read_npz(file, "head parameter file", ("expr", "shape"))
    rows = {key: checked_array(arrays, key, None, np.float64, file=file) for key in PER_TIMESTEP if key in arrays}
    count = len(rows["expr"]) if rows["expr"].ndim == 2 else 0
    for key, values in rows.items():
        if values.ndim < 2 or len(values) != count or count == 0:
            raise InputError(f"shape {values.shape}, expected a row for each timestep", file=file, field=key)
        if key in ("rotation", *FLAME_KEYS, "joint_rotations") and values.size % 3 == 0:
            check_angles(values.reshape(-1, 3), file, key)
    subject = {key: arrays[key] for key in ("shape", "static_offset") if key in arrays}
    first = HeadParameters.from_arrays({key: values[0] for key, values in rows.items()} | subject, model, file)
    subject.pop("static_offset", None)  # thousands of copies would fill the memory
    parameters = {0: first}
    for t in range(1, count):
        row = {key: values[t] for key, values in rows.items()}
        frame = HeadParameters.from_arrays(row | subject, model, file)
        parameters[t] = replace(frame, static_offset=first.static_offset)
    return parameters


def write_flame_param(file: Path, sequence: HeadSequence, model: HeadModel, level: float) -> None:
    """Write the parameters of all timesteps, with the subject's head at a level as static offset.

    Identity coefficients are 0 and the static offset holds the whole difference to the model's template: the joints
    follow from the sum of both. Changes of the blendshapes along the path have no place in the file.

    Args:
        file: Path to write.
        sequence: The subject.
        model: The head model whose template the offset is added to.
        level: Exaggeration, 0 for the natural head.

    Raises:
        InputError: If the model is not the subject's, or has other joints than FLAME.
    """
    head = sequence.head
    if not np.array_equal(head.faces, model.faces) or model.joint_names != FLAME_JOINTS:
        raise InputError("the head model must be the avatar's, with the joints of FLAME", file=file)
    timesteps = sorted(sequence.parameters)
    frames = [sequence.parameters[t] for t in timesteps]
    vertices = head.v_template + sequence.path.displacement(level)
    arrays = {
        "translation": np.stack([frame.translation for frame in frames]),
        "rotation": np.stack([frame.rotation for frame in frames]),
        "shape": np.zeros(model.num_identity),
        "expr": np.stack([frame.expression for frame in frames]),
        "static_offset": (vertices - model.v_template)[None],
        "dynamic_offset": np.zeros((len(frames), *vertices.shape)),
    }
    joints = np.stack([frame.joints for frame in frames])
    arrays |= {key: joints[:, rows].reshape(len(frames), -1) for key, rows in FLAME_KEYS.items()}
    with writing(file) as part:
        np.savez_compressed(part, **{key: value.astype(np.float32) for key, value in arrays.items()})
