"""Head models: linear blend skinning has conditions on its weights and joints."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from carigs.errors import InputError, collecting
from carigs.head import HeadModel
from carigs.mesh.triangle_mesh import diagonal
from carigs.plausibility.findings import Finding

TOLERANCE = 0.01
"""Of sums that must be 1: weights stored as 8-bit or 16-bit numbers pass."""
SIZES = (0.05, 5.0)
"""Diagonal of a head in metres. Larger and smaller ones are in another unit: millimetres, centimetres, decimetres."""

EXPORT = "export the head model again: every row of weights and of J_regressor sums to 1"
REORDER = "write joints and columns of weights in the order of the joints' names"

MISPLACED = 0.1
"""Distance of an eye's joint from the middle of the eyeball, as a share of the head's diagonal. It is 0 in FLAME."""


def check_head_model(model: HeadModel, file: Path, errors: list[InputError] | None = None) -> list[Finding]:
    """Check that a model can be posed.

    Args:
        model: The model.
        file: Its file, for messages.
        errors: Receives all errors; None to raise the first.

    Returns:
        What is likely to be wrong.

    Raises:
        InputError: If skinning weights are negative or do not sum to 1, a row of the joint regressor does not sum to 1
            (its joint would not follow a translation of the head), or the unit cannot be metres.
    """
    for error in _errors(model, file):
        with collecting(errors):
            raise error
    corners = (model.v_template - model.v_template.mean(axis=0)).astype(np.float64)[model.faces]
    volume = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    findings = list(_joint_findings(model, file))
    if volume < 0:
        kind = "the faces point inwards, so that their order of corners is reversed"
        remedy = "reverse the order of each face's corners"
        findings.append(Finding(kind, file, "f", f"its signed volume is {volume:.3g} m^3", remedy))
    return findings


def _joint_findings(model: HeadModel, file: Path) -> Iterator[Finding]:
    """Joints in places where they are only if joints, or columns of weights, are in another order than their names."""
    joints = {name: j for j, name in enumerate(model.joint_names)}
    limit = MISPLACED * diagonal(model.v_template)
    for eye in ("left_eye", "right_eye"):
        moved = model.weights[:, joints[eye]] > 0.5 if eye in joints else np.zeros(len(model.v_template), bool)
        if moved.any():
            distance = np.linalg.norm(model.v_template[moved].mean(axis=0) - model.joint_template[joints[eye]])
            if distance > limit:
                kind = "an eye's joint lies far from what it moves: are joints or skinning weights exchanged?"
                yield Finding(kind, file, "weights", f"{eye}: {distance:.3g} m", REORDER)
    if {"neck", "jaw"} <= set(joints):
        above = float(model.joint_template[joints["neck"], 1] - model.joint_template[joints["jaw"], 1])
        if above > 0.1 * limit:
            kind = "the joint of the neck lies above that of the jaw: are joints exchanged?"
            yield Finding(kind, file, "J_regressor", f"by {above:.3g} m", REORDER)


def _errors(model: HeadModel, file: Path) -> Iterator[InputError]:
    sums = model.weights.sum(axis=1, dtype=np.float64)
    worst = int(np.abs(sums - 1).argmax())
    if model.weights.min() < -TOLERANCE:
        vertex = int(model.weights.min(axis=1).argmin())
        problem = f"the skinning weight {model.weights[vertex].min():.3g} of vertex {vertex} is negative"
        yield InputError(problem, file=file, field="weights", remedy=EXPORT)
    elif abs(sums[worst] - 1) > TOLERANCE:
        problem = f"the skinning weights of vertex {worst} sum to {sums[worst]:.4g}; they must sum to 1"
        yield InputError(problem, file=file, field="weights", remedy=EXPORT)
    rows = model.joint_regressor.sum(axis=1, dtype=np.float64)
    joint = int(np.abs(rows - 1).argmax())
    if abs(rows[joint] - 1) > TOLERANCE:
        problem = f"row {joint} sums to {rows[joint]:.4g}; it must sum to 1, for a joint is a mean of vertices"
        yield InputError(problem, file=file, field="J_regressor", remedy=EXPORT)
        return
    size = diagonal(model.v_template)
    if not SIZES[0] < size < SIZES[1]:
        problem = f"the head is {size:.3g} m large; lengths are in metres"
        remedy = "divide by 1000 if the lengths are in millimetres"
        yield InputError(problem, file=file, field="v_template", remedy=remedy)
    distances = np.linalg.norm(model.joint_template - model.v_template.mean(axis=0), axis=1)
    if distances.max() > size:
        joint = int(distances.argmax())
        problem = f"joint {joint} lies {distances[joint]:.3g} m from the centre of a head of {size:.3g} m"
        field = "J_regressor" if model.rest_joints is None else "joint_template"
        remedy = "write joints as means of the vertices around them, in metres"
        yield InputError(problem, file=file, field=field, remedy=remedy)
