"""The arrays of a head model's file, by FLAME's names: checks, and defaults where FLAME's format is silent.

FLAME names neither its joints nor the number of its identity blendshapes, and its joints follow from the vertices.
Models that differ in this hold `joint_names`, `num_identity`, and the pair `joint_template`, `joint_basis` besides.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from carigs.errors import InputError
from carigs.head.surface_points import checked_points
from carigs.readers.arrays import checked_array

FLAME_JOINTS = ("root", "neck", "jaw", "left_eye", "right_eye")
FLAME_NUM_IDENTITY = 300
MAX_JOINTS = 1000
TOLERANCE = 0.01
"""Of weights that sum to 1: weights stored as 8-bit or 16-bit numbers pass."""
LARGEST_COORDINATE = 1e4
"""Largest coordinate of a head in metres, without its sign; what uses the vertices may overflow beyond."""
POSSIBLE = -LARGEST_COORDINATE, LARGEST_COORDINATE


class RestJoints(NamedTuple):
    """Joints of the unposed head that a model stores itself: template + basis . coefficients, in metres."""

    template: Float[np.ndarray, "j 3"]
    basis: Float[np.ndarray, "j 3 b"]


def checked_fields(arrays: Mapping[str, Any], file: Path, prefix: str = "") -> dict[str, Any]:
    """Check the arrays of a head model.

    Args:
        arrays: Arrays by FLAME's names; sparse matrices of SciPy are taken, too.
        file: Where they come from, for messages.
        prefix: What precedes their names.

    Returns:
        The fields of `carigs.head.HeadModel`.

    Raises:
        InputError: If an array is missing, of another shape or kind, or holds a value that is not possible.
    """
    dense = {name: value.toarray() if hasattr(value, "toarray") else value for name, value in arrays.items()}

    def take(name: str, shape: tuple[int | None, ...], dtype: Any, **limits: Any) -> np.ndarray:
        return checked_array(dense, prefix + name, shape, dtype, **limits, file=file)

    def has(name: str) -> bool:
        return prefix + name in dense

    def refuse(is_bad: bool, name: str, problem: str) -> None:
        if is_bad:
            raise InputError(problem, file=file, field=prefix + name)

    def refuse_sums(weights: Float[np.ndarray, "n k"], name: str, what: str) -> None:
        sums = weights.sum(axis=1, dtype=np.float64)
        for wrong in np.flatnonzero(np.abs(sums - 1) > TOLERANCE)[:1]:
            refuse(True, name, f"the weights of {what} {wrong} sum to {sums[wrong]:.4g}, expected 1")

    v_template = take("v_template", (None, 3), np.float32, within=POSSIBLE)
    v = len(v_template)
    faces = take("f", (None, 3), np.int32, below=v)
    refuse(len(faces) == 0, "f", "holds no faces")
    for repeated in np.flatnonzero((faces == faces[:, [1, 2, 0]]).any(axis=1))[:1]:
        refuse(True, "f", f"triangle {repeated} names a vertex twice")
    parents, joints = take("kintree_table", (2, None), np.int64)
    j = len(joints)
    refuse(not 0 < j <= MAX_JOINTS, "kintree_table", f"{j} joints; 1 to {MAX_JOINTS} are expected")
    refuse((joints != np.arange(j)).any(), "kintree_table", "its second row must count the joints from 0")
    parents = np.concatenate([[-1], parents[1:]])
    ordered = (parents[1:] >= 0).all() and (parents[1:] < np.arange(1, j)).all()
    refuse(not ordered, "kintree_table", "each joint must come after its parent")
    names: Sequence[str] = FLAME_JOINTS if j == len(FLAME_JOINTS) else [f"joint_{i}" for i in range(j)]
    if has("joint_names"):
        names = take("joint_names", (j,), np.str_)
        refuse(len(set(names)) < j, "joint_names", "a name appears twice")
    shapedirs = take("shapedirs", (v, 3, None), np.float32)
    b = shapedirs.shape[2]
    identities = int(take("num_identity", (), np.int64)) if has("num_identity") else FLAME_NUM_IDENTITY
    expected = f"{identities} identity columns and at least one expression are expected"
    refuse(not 0 <= identities < b, "shapedirs", f"{b} columns; {expected}")
    posedirs = take("posedirs", (v, 3, None), np.float32)
    p = posedirs.shape[2]
    refuse(p % 9 > 0 or p > 9 * j, "posedirs", f"{p} columns; 9 for each of at most {j} joints are expected")
    rest_joints = None
    if has("joint_template"):
        joint_template = take("joint_template", (j, 3), np.float32, within=POSSIBLE)
        rest_joints = RestJoints(joint_template, take("joint_basis", (j, 3, b), np.float32))
    weights = take("weights", (v, j), np.float32, within=(-TOLERANCE, 1 + TOLERANCE))
    refuse_sums(weights, "weights", "vertex")
    regressor = take("J_regressor", (j, v), np.float32)
    if rest_joints is None:
        refuse_sums(regressor, "J_regressor", "joint")
    expressions = take("expression_names", (None,), np.str_) if has("expression_names") else ()
    refuse(len(expressions) > b - identities, "expression_names", f"more names than the {b - identities} expressions")
    refuse(len(set(expressions)) < len(expressions), "expression_names", "a name appears twice")
    region_names = [name.removeprefix(f"{prefix}mask_") for name in arrays if name.startswith(f"{prefix}mask_")]
    return {
        "v_template": v_template,
        "faces": faces,
        "shapedirs": shapedirs,
        "posedirs": posedirs,
        "joint_regressor": regressor,
        "weights": weights,
        "parents": parents,
        "num_identity": identities,
        "joint_names": tuple(map(str, names)),
        "rest_joints": rest_joints,
        "regions": {name: take(f"mask_{name}", (None,), np.int64, below=v) for name in region_names},
        "expression_names": tuple(map(str, expressions)),
        "landmarks68": checked_points(dense, f"{prefix}landmarks68", 68, v, file) if has("landmarks68") else None,
    }
