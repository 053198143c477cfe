"""Head models: linear blend skinning has conditions on its weights and joints."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from carigs.errors import InputError, collecting
from carigs.head import HeadModel
from carigs.mesh.triangle_mesh import diagonal
from carigs.plausibility.findings import Finding

SIZES = (0.05, 5.0)
"""Diagonal of a head in metres. Larger and smaller ones are in another unit: millimetres, centimetres, decimetres."""

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
        InputError: If the unit cannot be metres.
    """
    size = diagonal(model.v_template)
    with collecting(errors):
        if not SIZES[0] < size < SIZES[1]:
            problem = f"the head is {size:.3g} m large; lengths are in metres"
            remedy = "divide by 1000 if the lengths are in millimetres"
            raise InputError(problem, file=file, field="v_template", remedy=remedy)
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
