"""Motions from coefficients of named expressions: tables of Live Link Face, of MediaPipe and of carigs, and JSON.

Live Link Face states rotations of the head in Unreal's axes, which are left-handed: with ARKit's axes of a face that
looks at the camera, yaw turns about -y, pitch about +x and roll about -z.
"""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from carigs.errors import CarigsWarning, InputError, SettingsError
from carigs.head.parameters import check_angles
from carigs.motion.editing import at_times
from carigs.motion.facial_actions import ARKIT, actions
from carigs.motion.motion import FPS_RANGE, MAX_FRAMES, Motion
from carigs.motion.tables import IGNORED, Table, numbers, times_of
from carigs.readers.json_files import read_json

DEFAULT_FPS = 30.0
PERCENT, TOO_LARGE = 10.0, 2.0
"""Coefficients beyond the first are percentages; those beyond the second are warned of."""
HALF_TURN = 3.3
"""Radians beyond which a rotation of a joint, or a head before a camera, is in degrees."""
HEAD_ANGLES = {"headyaw": (1, -1.0), "headpitch": (0, 1.0), "headroll": (2, -1.0)}
"""Axis and sign of the rotations of the head in Live Link Face."""
EYE_ANGLES = frozenset(f"{side}eye{angle}" for side in ("left", "right") for angle in ("yaw", "pitch", "roll"))
"""Rotations of the eyes: the same as eyeLook..., whose meaning Apple states."""
MOST_TREMBLE = 0.75
"""Frames by which a frame of an even motion is early or late."""
MOST_SHIFT = 1.0
"""The same where the rate is known: fractions of a frame in timecodes are less than one."""
SAME_RATE = 0.002
"""Relative difference to a whole rate below which it is that rate."""
VECTORS = ("rotation", "translation", "rest_rotation", "rest_translation")
_AXIS = re.compile(r"(.+)_([xyz])")


def table_motion(table: Table, file: Path, fps: float | None) -> Motion:
    """Make a motion of a table.

    Args:
        table: Columns of coefficients, angles and vectors.
        file: The file, for messages.
        fps: Frames per second where the file states no times; None for 30.

    Returns:
        The motion, at the rate of its times.

    Raises:
        InputError: If a number or a name is not possible, or no column names an expression.
    """
    table = _without_gaps(table, file)
    lowered = [name.lower() for name in table.names]
    bases = [match[1] for name in lowered if (match := _AXIS.fullmatch(name))]
    vectors = {base for base in bases if bases.count(base) == 3}
    kept = [
        place for place, name in enumerate(lowered)
        if name not in IGNORED and name and not ((match := _AXIS.fullmatch(name)) and match[1] in vectors)
    ]  # fmt: skip
    values = dict(zip([table.names[c] for c in kept], numbers(table, kept, file).T, strict=True))
    found = {
        base: numbers(table, [lowered.index(f"{base}_{axis}") for axis in "xyz"], file) for base in sorted(vectors)
    }
    return _motion(values, found, times_of(table, file), file, fps, own="timecode" not in lowered and "time" in lowered)


def arkit_motion(
    values: Mapping[str, Float[np.ndarray, " t"]], rotation: Float[np.ndarray, "t 3"] | None,
    times: Float[np.ndarray, " t"] | None, file: Path, fps: float | None,
) -> Motion:  # fmt: skip
    """Make a motion of coefficients.

    Args:
        values: Coefficients over time by name.
        rotation: Rotation vectors of the head.
        times: Seconds from the first frame, if known.
        file: The file, for messages.
        fps: Frames per second where the file states no times; None for 30.

    Returns:
        The motion.

    Raises:
        InputError: If no name is that of an expression.
    """
    vectors = {} if rotation is None else {"rotation": rotation}
    return _motion(values, vectors, None if times is None else (times, None), file, fps, own=False)


def _motion(
    values: Mapping[str, np.ndarray], vectors: Mapping[str, np.ndarray], times: tuple | None, file: Path,
    fps: float | None, *, own: bool,
) -> Motion:  # fmt: skip
    angles = {name.lower(): column for name, column in values.items() if name.lower() in HEAD_ANGLES}
    values = {n: c for n, c in values.items() if n.lower() not in HEAD_ANGLES and n.lower() not in EYE_ANGLES}
    unknown = [name for name in values if not actions(name) and not name.isdigit()]
    if len(unknown) == len(values) and not (own and vectors):
        problem = f"no column names an expression ({', '.join(unknown[:4]) or 'there are none'})"
        raise InputError(problem, file=file, remedy=f"names as ARKit's: {', '.join(ARKIT[:3])}, ...")
    if not own:
        _warn(unknown, f"{file.name}: columns that are no expressions of ARKit, left out", "")
        values = {name: column for name, column in values.items() if name not in unknown}
        known = frozenset().union(*map(actions, values))
        missing = [name for name in ARKIT if name != "tongueOut" and not actions(name) & known]
        _warn(missing, f"{file.name}: expressions that it does not have, taken as 0", "")
    values = _in_units(values, file)
    t = len(next(iter(values.values()), next(iter(vectors.values()), np.zeros(1))))
    vectors = dict(vectors)
    if angles and "rotation" not in vectors:
        vectors["rotation"] = _head_rotation(angles, t, file)
    for name, array in vectors.items():
        if name in ("rotation", "rest_rotation"):
            check_angles(array, file, name)
        elif name not in VECTORS and np.linalg.norm(array, axis=1).max() > HALF_TURN:
            raise InputError("turns by more than half a turn; rotations are in radians", file=file, field=name)
    rest = {name: vectors.pop(f"rest_{name}")[0] for name in ("rotation", "translation") if f"rest_{name}" in vectors}
    joints = {name: array for name, array in vectors.items() if name not in VECTORS}
    if own:  # a head that is turned in its first frame is at rest there
        for name in ("rotation", "translation"):
            rest.setdefault(name, vectors.get(name, np.zeros((1, 3)))[0])
    expression = np.stack([*values.values()], axis=1) if values else np.zeros((t, 0))
    pose = [vectors.get(name) for name in ("rotation", "translation")]
    pose += [rest.get(name, np.zeros(3)) for name in ("rotation", "translation")]
    try:
        motion = Motion(fps or DEFAULT_FPS, tuple(values), expression, joints, *pose)
    except SettingsError as error:
        raise InputError(str(error).removeprefix("motion: "), file=file) from error
    return motion if times is None else _evenly(motion, *times, file)


def _evenly(motion: Motion, times: np.ndarray, rate: float | None, file: Path) -> Motion:
    """The motion at a constant rate: frames that only tremble in time keep their numbers, gaps are bridged."""
    first = np.concatenate([[True], np.diff(times) > 0])  # of frames at one time the first
    if not first.all():
        _warn(["x"], f"{file.name}: {int((~first).sum())} frames at the time of the frame before, left out", None)
    motion, times = motion.frames(np.flatnonzero(first)), times[first]
    if len(times) < 2:
        return motion
    numbers = np.arange(len(times))
    mean = (len(times) - 1) / times[-1]
    even = np.abs(times * (rate or mean) - numbers).max() < (MOST_TREMBLE if rate is None else MOST_SHIFT)
    if rate is None:
        rate = mean if even else 1 / float(np.median(np.diff(times)))
        rate = round(rate) if abs(rate - round(rate)) < SAME_RATE * rate and rate >= 1 else rate
    rate = min(max(rate, FPS_RANGE[0]), FPS_RANGE[1])
    if even:
        return motion.with_columns(motion.columns(), rate)
    count = np.floor(times[-1] * rate + 0.01) + 1
    if count > MAX_FRAMES:
        raise InputError(
            f"its times span {times[-1]:.6g} s, {count:.0f} frames; at most {MAX_FRAMES} are read", file=file
        )
    return at_times(motion, np.interp(np.arange(int(count)) / rate, times, numbers), rate)


def _without_gaps(table: Table, file: Path) -> Table:
    """The table without rows in which the tracker had lost the face: all their numbers are empty."""
    numbers = [c for c, name in enumerate(table.names) if name.lower() not in IGNORED]
    kept = [i for i, row in enumerate(table.rows) if any(row[c] for c in numbers)]
    if len(kept) == len(table.rows):
        return table
    if not kept:
        raise InputError("all frames are empty", file=file)
    _warn(["x"], f"{file.name}: {len(table.rows) - len(kept)} frames without numbers, bridged", None)
    return Table(table.names, [table.rows[i] for i in kept], [table.lines[i] for i in kept])


def _in_units(values: Mapping[str, np.ndarray], file: Path) -> dict[str, np.ndarray]:
    """Coefficients from 0 to 1."""
    named = {name: float(np.abs(column).max()) for name, column in values.items() if actions(name)}
    largest = max(named, key=named.get, default="")
    if largest and named[largest] > PERCENT:
        _warn(["x"], f"{file.name}: {largest} reaches {named[largest]:g}: taken for percentages", None)
        return {name: column / 100 if name in named else column for name, column in values.items()}
    if largest and named[largest] > TOO_LARGE:
        _warn(["x"], f"{file.name}: {largest} reaches {named[largest]:g}, coefficients are from 0 to 1", None)
    return dict(values)


def _head_rotation(angles: Mapping[str, np.ndarray], t: int, file: Path) -> np.ndarray:
    """Rotation vectors of yaw, pitch and roll: pitch is applied in the turned head, roll in the pitched one."""
    euler = np.zeros((t, 3))
    for name, (axis, sign) in HEAD_ANGLES.items():
        if name in angles:
            euler[:, axis] = sign * angles[name]
    if np.abs(euler).max(initial=0) > HALF_TURN:
        _warn(["x"], f"{file.name}: the head turns by {np.abs(euler).max():g} rad: taken for degrees", None)
        euler = np.radians(euler)
    return Rotation.from_euler("YXZ", euler[:, [1, 0, 2]]).as_rotvec()


def read_scores(
    file: Path,
) -> tuple[dict[str, np.ndarray], Float[np.ndarray, "t 3"] | None, Float[np.ndarray, " t"] | None]:
    """Read scores of MediaPipe's face landmarker as JSON.

    Args:
        file: A list of frames, or an object with it as `frames`. A frame is an object from names to scores, a list of
            objects with `categoryName` or `category_name` and `score`, or an object that has one of these as
            `blendshapes` or `faceBlendshapes`, and may have `time`, `timestamp_ms` and `matrix`, the 16 numbers of the
            facial transformation matrix.

    Returns:
        Scores over time by name, rotation vectors of the head and times in seconds, where they are there.

    Raises:
        InputError: If it is something else.
    """
    content = read_json(file)
    frames = content.get("frames") if isinstance(content, dict) else content
    if not isinstance(frames, list) or not frames:
        raise InputError("expected a list of frames with scores", file=file)
    if len(frames) > MAX_FRAMES:
        raise InputError(f"{len(frames)} frames; at most {MAX_FRAMES} are read", file=file)
    scores = [_frame_scores(frame, file, i) for i, frame in enumerate(frames)]
    names = list(dict.fromkeys(name for frame in scores for name in frame if name.lower() not in IGNORED))
    values = {name: np.array([frame.get(name, 0.0) for frame in scores]) for name in names}
    rotation = None
    if all(isinstance(frame, dict) and "matrix" in frame for frame in frames):
        matrices = [_matrix(frame["matrix"], file, i) for i, frame in enumerate(frames)]
        rotation = Rotation.from_matrix(np.stack(matrices)).as_rotvec()
    times = None
    for key, unit in (("time", 1.0), ("timestamp_ms", 1e-3)):
        if all(isinstance(frame, dict) and _is_number(frame.get(key)) for frame in frames):
            times = unit * np.array([float(frame[key]) for frame in frames])
            if (np.diff(times) < 0).any():
                raise InputError("is earlier than in the frame before", file=file, field=key)
            times = times - times[0]
    if isinstance(content, dict) and times is None and _is_number(content.get("fps")) and content["fps"] > 0:
        times = np.arange(len(frames)) / float(content["fps"])
    return values, rotation, times


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _frame_scores(frame: Any, file: Path, place: int) -> dict[str, float]:
    for key in ("blendshapes", "faceBlendshapes", "face_blendshapes"):
        if isinstance(frame, dict) and key in frame:
            frame = frame[key]
            break
    if isinstance(frame, list) and len(frame) == 1 and isinstance(frame[0], list | dict) and "score" not in frame[0]:
        frame = frame[0]  # of several faces the first
    if isinstance(frame, dict) and isinstance(frame.get("categories"), list):
        frame = frame["categories"]
    if isinstance(frame, list):
        pairs = [
            (entry.get("categoryName", entry.get("category_name")), entry.get("score"))
            for entry in frame
            if isinstance(entry, dict)
        ]
        if len(pairs) < len(frame):
            pairs = [(None, None)]
    elif isinstance(frame, dict):
        pairs = [(n, v) for n, v in frame.items() if n.lower() not in IGNORED and n not in ("matrix", "frame")]
    else:
        pairs = [(None, None)]
    for name, value in pairs:
        if not isinstance(name, str) or not _is_number(value):
            problem = f"expected names with scores, found {str(name)[:40]}: {str(value)[:40]}"
            raise InputError(problem, file=file, field=f"frames[{place}]")
    return dict(pairs)


def _matrix(content: Any, file: Path, place: int) -> Float[np.ndarray, "3 3"]:
    """Rotation of MediaPipe's facial transformation matrix, row by row."""
    try:
        rotation = np.array(content, np.float64).reshape(4, 4)[:3, :3]
    except (ValueError, TypeError):
        rotation = np.zeros((3, 3))
    if not np.isfinite(rotation).all() or not 0.2 < np.linalg.det(rotation) < 5:
        raise InputError("expected 16 numbers of a rigid transform", file=file, field=f"frames[{place}].matrix")
    return rotation


def _warn(names: list[str], text: str, separator: str | None) -> None:
    if names:
        listed = "" if separator is None else f": {', '.join(names[:6])}{' ...' if len(names) > 6 else ''}"
        warnings.warn(CarigsWarning(text + listed), stacklevel=3)
