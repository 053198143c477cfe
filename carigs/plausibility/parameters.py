"""Head parameters: radians and coefficients that a head can have, and one neutral head for all timesteps."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from jaxtyping import Float

from carigs.capture import Capture
from carigs.capture.evenly_spread import evenly_spread
from carigs.errors import InputError, collecting
from carigs.head import HeadModel, HeadParameters
from carigs.head.model_arrays import FLAME_JOINTS
from carigs.mesh.triangle_mesh import diagonal
from carigs.plausibility.findings import Finding

JOINT_LIMIT = np.pi / 2
"""Neck, jaw and eyes turn by less than a right angle against the bone that they hang on."""
LIKELY_MOTION = 0.25
"""Expressions, identities and offsets move vertices by centimetres: less than this share of the head's size.
More than the whole size is certainly wrong."""
FARTHEST = 1e4
"""Metres from the origin of the world."""
FLAME_JOINT_FIELDS = ("neck_pose", "jaw_pose", "eyes_pose, left eye", "eyes_pose, right eye")
"""Where files hold the rotations of FLAME's joints."""
OTHER_COEFFICIENTS = "compare the coefficients with the head model's: another model, or another unit"
ONE_HEAD = "write the values of one neutral head into the files of all timesteps"
VERTICES = 1000
"""Number of vertices at which blendshapes are summed."""


def check_parameters(capture: Capture, errors: list[InputError] | None = None) -> list[Finding]:
    """Check the head parameters of all timesteps.

    Args:
        capture: The capture.
        errors: Receives all errors; None to raise the first.

    Returns:
        What is likely to be wrong.

    Raises:
        InputError: If a rotation exceeds a whole turn, blendshapes move vertices by more than the size of the head, or
            timesteps have different neutral heads.
    """
    ranges, first, findings = _Ranges(capture.model), None, []
    for timestep, name in capture.parameter_files.items():
        file, parameters = capture.root / name, capture.parameters(timestep)
        findings += ranges.check(parameters, file, errors)
        first = first or (file, parameters)
        _check_same_head(parameters, file, *reversed(first), errors)
    return findings


class _Ranges:
    """Ranges of the parameters of a head model."""

    def __init__(self, model: HeadModel) -> None:
        some = evenly_spread(range(len(model.v_template)), VERTICES)
        self.identity = model.identity_basis[some].reshape(3 * len(some), -1).astype(np.float64)
        self.expression = model.expression_basis[some].reshape(3 * len(some), -1).astype(np.float64)
        self.joints = FLAME_JOINT_FIELDS
        if model.joint_names != FLAME_JOINTS:
            self.joints = tuple(f"joint_rotations, {name}" for name in model.joint_names[1:])
        self.size = diagonal(model.v_template)

    def check(self, parameters: HeadParameters, file: Path, errors: list[InputError] | None) -> Iterator[Finding]:
        rotations = {"rotation": parameters.rotation} | dict(zip(self.joints, parameters.joints, strict=True))
        for field, vector in rotations.items():
            angle = float(np.linalg.norm(vector / np.pi) * np.pi)
            with collecting(errors):
                if angle > 2 * np.pi:
                    problem = f"a rotation of {angle:.4g} rad is more than a whole turn; rotations are in radians"
                    remedy = "multiply by pi / 180 if the rotations are in degrees"
                    raise InputError(problem, file=file, field=field, remedy=remedy)
            if 2 * np.pi >= angle > JOINT_LIMIT and field != "rotation":
                remedy = "compare with the neighbouring timesteps; track this one again"
                kind = "turns farther than a joint of a head can"
                yield Finding(kind, file, field, f"{angle:.3g} rad", remedy, angle)
        distance = np.abs(parameters.translation).max()
        with collecting(errors):
            if distance > FARTHEST:
                problem = f"the head is {distance:.3g} m from the origin; metres are expected"
                remedy = "divide by 1000 if the lengths are in millimetres"
                raise InputError(problem, file=file, field="translation", remedy=remedy)
        offsets = {"static_offset": parameters.static_offset, "dynamic_offset": parameters.dynamic_offset}
        motions = {
            "expr": self._motion(self.expression, parameters.expression),
            "shape": self._motion(self.identity, parameters.shape),
        } | {field: float(np.abs(offset).max()) for field, offset in offsets.items() if offset is not None}
        for field, motion in motions.items():
            details = f"by up to {motion:.3g} m, the head is {self.size:.3g} m large"
            with collecting(errors):
                if not motion < self.size:
                    raise InputError(f"moves vertices {details}", file=file, field=field, remedy=OTHER_COEFFICIENTS)
            if self.size > motion > LIKELY_MOTION * self.size:
                kind = "moves vertices farther than is likely"
                yield Finding(kind, file, field, details, OTHER_COEFFICIENTS, motion)

    def _motion(self, blendshapes: Float[np.ndarray, "n b"], coefficients: Float[np.ndarray, " b"]) -> float:
        """Largest displacement in metres."""
        used = np.flatnonzero(coefficients)
        with np.errstate(over="ignore", invalid="ignore"):
            displacement = np.abs(blendshapes[:, used] @ coefficients[used])
        return float(displacement.max(initial=0))


def _check_same_head(
    parameters: HeadParameters, file: Path, neutral: HeadParameters, other: Path, errors: list[InputError] | None
) -> None:
    """The tolerance is that of the stage train, which fits one set of surfels to one neutral head."""
    with collecting(errors):
        if not np.allclose(parameters.shape, neutral.shape, atol=1e-6):
            problem = f"differs from {other}'s; one subject has one shape"
            raise InputError(problem, file=file, field="shape", remedy=ONE_HEAD)
    a, b = (np.zeros(1) if p.static_offset is None else p.static_offset for p in (parameters, neutral))
    with collecting(errors):
        if not np.allclose(a, b, atol=1e-6):
            problem = f"differs from {other}'s; one subject has one neutral head"
            raise InputError(problem, file=file, field="static_offset", remedy=ONE_HEAD)
