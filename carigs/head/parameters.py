"""Tracked head parameters of one frame, in the npz layout of GaussianAvatars and VHAP."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from carigs.errors import InputError
from carigs.head.model import HeadModel
from carigs.head.model_arrays import FLAME_JOINTS, FLAME_NUM_IDENTITY
from carigs.head.teeth import FLAME_COUNTS, FLAME_WITH_TEETH_COUNTS, TEETH_COUNTS
from carigs.readers.arrays import checked_array
from carigs.readers.npz import read_npz

FLAME_KEYS = {"neck_pose": slice(0, 1), "jaw_pose": slice(1, 2), "eyes_pose": slice(2, 4)}
"""Rows of `joints` in files of FLAME's five joints."""
LARGEST_ANGLE = 4 * np.pi
"""Largest angle of a rotation vector in radians: two turns. One is enough, but a tracker may count on."""
MAX_BYTES = 64 << 20
"""Largest sum of the arrays of a frame, in bytes."""


def flame_joints(**rotations: object) -> Float[np.ndarray, "4 3"]:
    """Rotations of FLAME's joints by name.

    Args:
        **rotations: Rotation vectors of `neck`, `jaw`, `left_eye` and `right_eye` in radians; the others are 0.

    Returns:
        The field `joints` of `HeadParameters`.

    Example:
        >>> flame_joints(jaw=[0.3, 0, 0])[1]
        array([0.3, 0. , 0. ])
    """
    joints = np.zeros((len(FLAME_JOINTS) - 1, 3))
    for name, vector in rotations.items():
        joints[FLAME_JOINTS.index(name) - 1] = vector
    return joints


def check_angles(vectors: Float[np.ndarray, "*n 3"], file: str | Path, field: str) -> None:
    """Refuse rotation vectors that no head has, such as those in degrees.

    Args:
        vectors: Rotation vectors in radians.
        file: Where they come from, for messages.
        field: Their name, for messages.

    Raises:
        InputError: If one is longer than `LARGEST_ANGLE`.
    """
    largest = float(np.linalg.norm(vectors / LARGEST_ANGLE, axis=-1).max(initial=0))
    if largest > 1:
        problem = f"a rotation of {largest * LARGEST_ANGLE:.4g} rad is more than two turns; rotations are in radians"
        raise InputError(problem, file=file, field=field)


@dataclass(frozen=True)
class HeadParameters:
    """Parameters of one frame, by default 0 in FLAME's sizes.

    Rotations are axis-angle vectors in radians, each relative to the parent joint; lengths are in metres.
    """

    translation: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    rotation: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """Of the whole head, about the root joint."""
    joints: Float[np.ndarray, "j 3"] = field(default_factory=flame_joints)
    """Of the other joints, in the model's order: of FLAME neck, jaw, left eye, right eye."""
    shape: Float[np.ndarray, " i"] = field(default_factory=lambda: np.zeros(FLAME_NUM_IDENTITY))
    """Coefficients of the identity blendshapes."""
    expression: Float[np.ndarray, " e"] = field(default_factory=lambda: np.zeros(100))
    """Coefficients of the expression blendshapes."""
    static_offset: Float[np.ndarray, "v 3"] | None = None
    """Added to the shaped template in all frames."""
    dynamic_offset: Float[np.ndarray, "v 3"] | None = None
    """Added to the shaped template in this frame."""

    @classmethod
    def zeros(cls, model: HeadModel) -> HeadParameters:
        """Parameters of a model's template.

        Args:
            model: The head model.

        Returns:
            Zeros in the sizes of the model.
        """
        joints = np.zeros((len(model.parents) - 1, 3))
        return cls(joints=joints, shape=np.zeros(model.num_identity), expression=np.zeros(model.num_expressions))

    @classmethod
    def load(cls, file: str | Path, model: HeadModel) -> HeadParameters:
        """Read one frame and check it against the model.

        Args:
            file: The .npz file: rotations of joints are `neck_pose`, `jaw_pose` and `eyes_pose` (left eye, then right
                eye) for models with FLAME's joints, else `joint_rotations`. Offsets without FLAME's teeth do not move
                them.
            model: The head model.

        Returns:
            The parameters; missing trailing coefficients are 0.

        Raises:
            InputError: If the file is missing or cannot be read, or an array is missing, of another shape, or not
                finite.
        """
        return cls.from_arrays(read_npz(file, "head parameter file", limit=MAX_BYTES), model, file)

    @classmethod
    def from_arrays(cls, arrays: Mapping[str, np.ndarray], model: HeadModel, file: str | Path) -> HeadParameters:
        """Check the arrays of one frame against the model.

        Args:
            arrays: Arrays by the names of a file that `load` reads.
            model: The head model.
            file: Where they come from, for messages.

        Returns:
            The parameters; missing trailing coefficients are 0.

        Raises:
            InputError: If an array is missing, of another shape, or not finite.
        """

        def take(key: str, size: int, *, at_most: bool = False) -> np.ndarray:
            value = checked_array(arrays, key, None, np.float64, file=file).reshape(-1)
            if value.size != size and not (at_most and 0 < value.size < size):
                raise InputError(f"{value.size} values, expected {size}", file=file, field=key)
            return np.pad(value, (0, size - value.size))

        def offset(key: str) -> np.ndarray | None:
            if key not in arrays:
                return None
            value, v = checked_array(arrays, key, None, np.float64, file=file), len(model.v_template)
            if v == FLAME_WITH_TEETH_COUNTS[0] and value.shape[-2:] == (FLAME_COUNTS[0], 3):
                value = np.concatenate([value.reshape(-1, 3), np.zeros((TEETH_COUNTS[0], 3))])
            if value.shape[-2:] != (v, 3) or value.size != v * 3:
                raise InputError(f"shape {value.shape}, the model has {v} vertices", file=file, field=key)
            return value.reshape(v, 3)

        if model.joint_names == FLAME_JOINTS:
            joints = np.concatenate([take(key, 3 * (rows.stop - rows.start)) for key, rows in FLAME_KEYS.items()])
        else:
            joints = take("joint_rotations", 3 * (len(model.parents) - 1))
        return cls(
            translation=take("translation", 3),
            rotation=take("rotation", 3),
            joints=joints.reshape(-1, 3),
            shape=take("shape", model.num_identity, at_most=True),
            expression=take("expr", model.num_expressions, at_most=True),
            static_offset=offset("static_offset"),
            dynamic_offset=offset("dynamic_offset"),
        )

    def save(self, file: str | Path, model: HeadModel) -> None:
        """Write the npz layout that `load` and the tools of GaussianAvatars read.

        Args:
            file: File to create or replace.
            model: The head model, for the names of its joints and the shape of a missing static offset.
        """
        static = np.zeros(model.v_template.shape) if self.static_offset is None else self.static_offset
        arrays = {
            "translation": self.translation[None],
            "rotation": self.rotation[None],
            "shape": self.shape,
            "expr": self.expression[None],
            "static_offset": static[None],
        }
        if model.joint_names == FLAME_JOINTS:
            arrays |= {key: self.joints[rows].reshape(1, -1) for key, rows in FLAME_KEYS.items()}
        else:
            arrays["joint_rotations"] = self.joints
        if self.dynamic_offset is not None:
            arrays["dynamic_offset"] = self.dynamic_offset[None]
        np.savez(file, **{key: value.astype(np.float32) for key, value in arrays.items()})
