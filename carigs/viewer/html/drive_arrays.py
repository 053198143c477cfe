"""What moves the head of the page beyond its capture: expressions with sliders, and named clips.

A frame of a clip, and the sliders, change the first captured timestep or the shown one: they add multiples of columns
to its vertices before the joints turn,

    sum_e d_e (column(e) + sum_k l_k(g) change(k, e)),

with the differences d of the coefficients (of expressions, and of pose correctives: the entries of R - I of their
joints) and the Lagrange weights l_k of the level g. Columns are sparse and are stored as they are; changes are sums of
few rows.
A frame has its coefficients, rotation vectors of the joints and translation: kilobytes for a clip. Its light is found
once a second, in the basis that the captured light has.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float, Int

from carigs.exaggeration import Caricature
from carigs.head import HeadParameters
from carigs.motion.facial_actions import actions
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.viewer.html.light_arrays import Light, light_factors
from carigs.viewer.html.low_rank import low_rank
from carigs.viewer.html.packed_arrays import PackedArray, pack_exact, pack_integers, pack_steps

COLUMN_STEP = 2e-5
"""Metres that a coefficient of 1 moves a vertex."""
CHANGE_TOLERANCE = 2e-5
COEFFICIENT_STEP, ANGLE_STEP, TRANSLATION_STEP = 1 / 500, 1 / 2000, 1e-5
"""Of coefficients, rotation vectors in radians, and translations in metres."""
LIGHT_SECONDS = 1.0
"""Time between the frames of a clip at which the light is found."""
SLIDERS: dict[str, tuple[str, ...]] = {
    "jaw open": ("jaw_open",),
    "smile": ("mouth_smile_left", "mouth_smile_right"),
    "frown": ("mouth_frown_left", "mouth_frown_right"),
    "pucker": ("mouth_pucker",),
    "eyes closed": ("eye_blink_left", "eye_blink_right"),
    "eyes wide": ("eye_wide_left", "eye_wide_right"),
    "brows up": ("brow_inner_up_left", "brow_inner_up_right", "brow_outer_up_left", "brow_outer_up_right"),
    "brows down": ("brow_down_left", "brow_down_right"),
    "cheeks puffed": ("cheek_puff_left", "cheek_puff_right"),
}
"""Expressions that people look for first, and their facial actions."""
NUMBERED = 5
"""Sliders of a head whose expressions have no names: those that move it most."""
NUMBERED_RANGE = 2.0
JOINT_SLIDERS = (("jaw", "jaw", 0, 20.0), ("look left", "eyes", 1, 30.0), ("look down", "eyes", 0, 20.0))
"""Name, joint, axis and largest angle in degrees."""


class PageClip(NamedTuple):
    """A motion of the page."""

    name: str
    fps: float
    parameters: Sequence[HeadParameters]
    sound: str | None = None
    """Data URI of what is heard."""


def drive_arrays(
    sequence: HeadSequence, timestep: int, clips: Sequence[PageClip], light: Light | None
) -> tuple[dict[str, Any], list[PackedArray]]:
    """Pack sliders and clips.

    Args:
        sequence: Head model, parameters over time, and gamma path.
        timestep: First timestep of the page.
        clips: The clips.
        light: Light of the captured frames; None if colours do not follow the light.

    Returns:
        Numbers for the header of the page, and the arrays.
    """
    head, base = sequence.head, sequence.parameters[timestep]
    sliders, wanted = _sliders(sequence)
    frames = [base, *(frame for clip in clips for frame in clip.parameters)]
    expressions = np.array([frame.expression for frame in frames])
    moves = head.expression_basis.any(axis=(0, 1))
    wanted[moves & (expressions != expressions[0]).any(axis=0)] = True
    columns = np.flatnonzero(wanted)
    place = {column: i for i, column in enumerate(columns.tolist())}
    for slider in sliders:
        slider["columns"] = [[place[column], weight] for column, weight in slider["columns"]]
    corrected = head.posedirs.shape[2] if head.posedirs.any() else 0
    basis = np.concatenate([head.expression_basis[:, :, columns], head.posedirs[:, :, :corrected]], axis=2)
    joints = np.zeros((basis.shape[2], len(head.parents), 3))
    joints[: len(columns)] = head.joint_basis[:, :, head.num_identity + columns].transpose(2, 0, 1)
    rows, moved = _changes(sequence, columns, corrected)
    found = low_rank(rows, CHANGE_TOLERANCE, COLUMN_STEP)
    arrays = [
        pack_steps("column_basis", basis.reshape(-1, basis.shape[2]), COLUMN_STEP),
        pack_exact("column_joints", joints.reshape(len(joints), -1)),
        pack_exact("change_coefficients", found.coefficients),
        pack_integers("change_basis", found.basis.T),
        pack_exact("change_joints", moved.reshape(len(moved), -1)),
    ]
    described = []
    for i, clip in enumerate(clips):
        arrays += _clip(sequence, base, clip, columns, i, light)
        described.append(
            {"name": clip.name, "fps": clip.fps, "frames": len(clip.parameters), "sound": bool(clip.sound)}
        )
    names = list(head.joint_names)
    turning = [
        {"name": name, "joints": ids, "axis": axis, "degrees": degrees}
        for name, joint, axis, degrees in JOINT_SLIDERS
        if (ids := [names.index(n) for n in (["left_eye", "right_eye"] if joint == "eyes" else [joint]) if n in names])
        and not (joint == "jaw" and any(slider["name"] == "jaw open" for slider in sliders))
    ]
    header = {
        "clips": described,
        "sliders": sliders,
        "turning": turning,
        "columns": basis.shape[2],
        "corrected": corrected,
    }
    return header, arrays


def _sliders(sequence: HeadSequence) -> tuple[list[dict[str, Any]], np.ndarray]:
    """The sliders of expressions, and which expressions they need."""
    head = sequence.head
    wanted, sliders = np.zeros(head.num_expressions, bool), []
    by_action = {action: i for i, name in enumerate(head.expression_names) for action in actions(name)}
    for name, needed in SLIDERS.items():
        columns = sorted({by_action[action] for action in needed if action in by_action})
        if columns:
            sliders.append({"name": name, "low": 0.0, "high": 1.0, "columns": [[c, 1.0] for c in columns]})
    if not sliders:
        size = (head.expression_basis**2).sum(axis=(0, 1))
        for c in np.argsort(-size, kind="stable")[:NUMBERED].tolist():
            if size[c] > 0:
                ends = {"low": -NUMBERED_RANGE, "high": NUMBERED_RANGE}
                sliders.append({"name": f"expression {c}", **ends, "columns": [[c, 1.0]]})
    for slider in sliders:
        wanted[[column for column, _ in slider["columns"]]] = True
    return sliders, wanted


def _changes(
    sequence: HeadSequence, columns: Int[np.ndarray, " n"], corrected: int
) -> tuple[Float[np.ndarray, "r m"], Float[np.ndarray, "r j 3"]]:
    """Change of every column at the nodes of the path but the first, and of the joints by it."""
    head, path = sequence.head, sequence.path
    regressor = head.joint_regressor.astype(np.float64)
    rows, joints = [], []
    for level in path.levels[1:].tolist():
        caricature: Caricature = path.at(level)
        for column in columns.tolist():
            one = np.zeros(head.num_expressions)
            one[column] = 1
            change = np.asarray(caricature.blendshape_change(one), np.float64) + np.zeros(head.v_template.shape)
            rows.append(change.reshape(-1))
            joints.append(regressor @ change)
        for entry in range(corrected):
            one = np.eye(head.posedirs.shape[2])[entry]
            change = np.asarray(caricature.blendshape_change(one, first=head.num_expressions), np.float64)
            rows.append((change + np.zeros(head.v_template.shape)).reshape(-1))
            joints.append(np.zeros((len(head.parents), 3)))
    if not rows:
        return np.zeros((0, head.v_template.size)), np.zeros((0, len(head.parents), 3))
    return np.array(rows), np.array(joints)


def _clip(
    sequence: HeadSequence, base: HeadParameters, clip: PageClip, columns: np.ndarray, number: int,
    light: Light | None,
) -> list[PackedArray]:  # fmt: skip
    """Frames of a clip: differences of its coefficients to the base, rotations and translations; and its light."""
    frames = list(clip.parameters)
    coefficients = np.array([frame.expression[columns] - base.expression[columns] for frame in frames])
    vectors = np.array([np.concatenate([frame.rotation[None], frame.joints]).reshape(-1) for frame in frames])
    name = f"clip{number}"
    arrays = [
        _over_time(f"{name}_coefficients", coefficients, COEFFICIENT_STEP),
        _over_time(f"{name}_vectors", vectors, ANGLE_STEP),
        _over_time(f"{name}_translations", np.array([frame.translation for frame in frames]), TRANSLATION_STEP),
    ]
    if light is not None:
        step = max(round(LIGHT_SECONDS * clip.fps), 1)
        keys = np.unique([*range(0, len(frames), step), len(frames) - 1])
        ends = [light_factors(sequence, frames[k], caricature) for caricature in light.ends for k in keys]
        shares = np.linalg.lstsq(light.basis.T, (np.array(ends) - light.mean).T)[0].T
        arrays += [pack_exact(f"{name}_light", shares), pack_integers(f"{name}_light_frames", keys)]
    return arrays


def _over_time(name: str, values: Float[np.ndarray, "t n"], step: float) -> PackedArray:
    """Multiples of a step as differences of successive frames, which deflate well."""
    return pack_integers(name, np.rint(values / step).astype(np.int64), delta=True, step=step)
