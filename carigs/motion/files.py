"""Motion files: which format a file has, and carigs' own ones.

`.npz` of carigs holds a motion exactly. `.csv` of carigs has a column `time`, one for each expression, and
`rotation_x`, `translation_y`, `jaw_x`, `left_eye_y` and so on for what is not zero.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from carigs.errors import InputError, SettingsError
from carigs.head import HeadModel
from carigs.motion.coefficients import arkit_motion, read_scores, table_motion
from carigs.motion.head_parameters import parameter_files, read_parameters
from carigs.motion.live_link import write_live_link
from carigs.motion.motion import Motion
from carigs.motion.tables import read_table
from carigs.readers.arrays import checked_array
from carigs.readers.formats import Format, check_npz_format
from carigs.readers.npz import read_npz
from carigs.system.files import writing

FORMAT = Format("carigs-motion", 1, "write it again")
DEFAULT_FPS = 30.0
"""Frames per second of files that state none."""
MAX_BYTES = 2 << 30


def read_motion(file: str | Path, *, fps: float | None = None, head: HeadModel | None = None) -> Motion:
    """Read a motion.

    Args:
        file: An .npz or .csv of carigs; a .csv of Live Link Face or any table of ARKit's coefficients; scores of
            MediaPipe's blendshapes (.csv, .json); a folder of head parameters (a dataset of GaussianAvatars or VHAP, or
            npz files of one frame each); an .npz of a sequence (`flame_param.npz`, VHAP, DECA, EMOCA, SMIRK).
        fps: Frames per second, where the file does not state times; None for `DEFAULT_FPS`.
        head: Head model of the driver, which names the coefficients of head parameters; None leaves them numbered,
            except in folders with a `head_model.npz`.

    Returns:
        The motion.

    Raises:
        InputError: If the file is missing, broken, or of no known format; names the place.

    Warns:
        CarigsWarning: Values in other units, columns that are missing or not known, gaps.

    Example:
        >>> import carigs.motion
        >>> motion = carigs.motion.read_motion("take.csv")  # doctest: +SKIP
    """
    file = Path(file)
    if fps is not None and not 1 <= fps <= 1000:
        raise SettingsError(f"motion: {fps:g} frames per second; expected 1 to 1000")
    if file.is_dir():
        return read_parameters(parameter_files(file), file, fps or DEFAULT_FPS, head)
    suffix = file.suffix.lower()
    if suffix == ".npz":
        return _read_npz(file, fps, head)
    if suffix == ".csv":
        table = read_table(file)
        return table_motion(table, file, fps)
    if suffix == ".json":
        return arkit_motion(*read_scores(file), file, fps)
    raise InputError("a motion is .npz, .csv, .json, or a folder of head parameters", file=file)


def _read_npz(file: Path, fps: float | None, head: HeadModel | None) -> Motion:
    arrays = read_npz(file, "motion file", limit=MAX_BYTES)
    if "format" not in arrays:
        return read_parameters([file], file, fps or DEFAULT_FPS, head)
    check_npz_format(arrays, FORMAT, file)

    def take(name: str, *shape: int | None, dtype: Any = np.float64) -> np.ndarray:
        return checked_array(arrays, name, shape, dtype, file=file)

    names = take("names", None, dtype=np.str_)
    expression = take("expression", None, len(names))
    t = len(expression)
    joints = {name.removeprefix("joint_"): take(name, t, 3) for name in arrays if name.startswith("joint_")}
    try:
        return Motion(
            float(take("fps")), tuple(map(str, names)), expression, joints, take("rotation", t, 3),
            take("translation", t, 3), take("rest_rotation", 3), take("rest_translation", 3),
        )  # fmt: skip
    except SettingsError as error:
        raise InputError(str(error).removeprefix("motion: "), file=file) from error


def write_motion(file: str | Path, motion: Motion) -> None:
    """Write a motion.

    Args:
        file: .npz for all of it as it is, .csv for a table of carigs, or a name that ends with `arkit.csv` for the
            columns of Live Link Face.
        motion: The motion.

    Raises:
        InputError: If the suffix is another one.
        SettingsError: If the file is for ARKit and no expression has a name of ARKit.
    """
    file = Path(file)
    if file.name.lower().endswith("arkit.csv"):
        write_live_link(file, motion)
    elif file.suffix.lower() == ".csv":
        _write_csv(file, motion)
    elif file.suffix.lower() == ".npz":
        with writing(file) as part:
            np.savez_compressed(
                part, format=str(FORMAT), fps=motion.fps, names=np.array(motion.names, np.str_),
                expression=motion.expression, rotation=motion.rotation, translation=motion.translation,
                rest_rotation=motion.rest_rotation, rest_translation=motion.rest_translation,
                **{f"joint_{name}": rotations for name, rotations in motion.joints.items()},
            )  # fmt: skip
    else:
        raise InputError("a motion is written as .npz or .csv", file=file)


def _write_csv(file: Path, motion: Motion) -> None:
    columns = {"time": np.arange(len(motion)) / motion.fps}
    columns |= dict(zip(motion.names, motion.expression.T, strict=True))
    vectors = {"rotation": motion.rotation, "translation": motion.translation, **motion.joints}
    for name in ("rotation", "translation"):
        rest = getattr(motion, f"rest_{name}")
        if not np.array_equal(rest, vectors[name][0]):
            vectors[f"rest_{name}"] = np.tile(rest, (len(motion), 1))
    for name, array in vectors.items():
        if array.any():
            columns |= {f"{name}_{axis}": column for axis, column in zip("xyz", array.T, strict=True)}
    rows = np.stack(list(columns.values()), axis=1)
    lines = [",".join(columns), *(",".join(f"{value:.10g}" for value in row) for row in rows.tolist())]
    with writing(file) as part:
        part.write_text("\n".join([*lines, ""]), encoding="utf-8")
