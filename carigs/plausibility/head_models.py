"""Head models: linear blend skinning has conditions on its weights and joints."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from carigs.errors import InputError
from carigs.head import HeadModel
from carigs.mesh.triangle_mesh import diagonal
from carigs.plausibility.findings import Finding

TOLERANCE = 0.01
"""Of sums that must be 1: weights stored as 8-bit or 16-bit numbers pass."""
SIZES = (0.05, 5.0)
"""Diagonal of a head in metres. Larger and smaller ones are in another unit: millimetres, centimetres, decimetres."""


def check_head_model(model: HeadModel, file: Path) -> list[Finding]:
    """Check that a model can be posed.

    Args:
        model: The model.
        file: Its file, for messages.

    Returns:
        What is likely to be wrong.

    Raises:
        InputError: If skinning weights are negative or do not sum to 1, a row of the joint regressor does not sum to 1
            (its joint would not follow a translation of the head), or the unit cannot be metres.
    """
    sums = model.weights.sum(axis=1, dtype=np.float64)
    worst = int(np.abs(sums - 1).argmax())
    if model.weights.min() < -TOLERANCE:
        vertex = int(model.weights.min(axis=1).argmin())
        problem = f"the skinning weight {model.weights[vertex].min():.3g} of vertex {vertex} is negative"
        raise InputError(problem, file=file, field="weights")
    if abs(sums[worst] - 1) > TOLERANCE:
        problem = f"the skinning weights of vertex {worst} sum to {sums[worst]:.4g}; they must sum to 1"
        raise InputError(problem, file=file, field="weights")
    rows = model.joint_regressor.sum(axis=1, dtype=np.float64)
    joint = int(np.abs(rows - 1).argmax())
    if abs(rows[joint] - 1) > TOLERANCE:
        problem = f"row {joint} sums to {rows[joint]:.4g}; it must sum to 1, for a joint is a mean of vertices"
        raise InputError(problem, file=file, field="J_regressor")
    size = diagonal(model.v_template)
    if not SIZES[0] < size < SIZES[1]:
        raise InputError(f"the head is {size:.3g} m large; lengths are in metres", file=file, field="v_template")
    joints = model.joint_template
    centre = model.v_template.mean(axis=0)
    distances = np.linalg.norm(joints - centre, axis=1)
    if distances.max() > size:
        joint = int(distances.argmax())
        problem = f"joint {joint} lies {distances[joint]:.3g} m from the centre of a head of {size:.3g} m"
        field = "J_regressor" if model.rest_joints is None else "joint_template"
        raise InputError(problem, file=file, field=field)
    findings = []
    corners = (model.v_template - centre).astype(np.float64)[model.faces]
    volume = np.einsum("fi,fi->", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])) / 6
    if volume < 0:
        details = f"its signed volume is {volume:.3g} m^3"
        findings.append(
            Finding("the faces point inwards, so that their order of corners is reversed", file, "f", details)
        )
    return findings
