"""Tracked head parameters of one frame, in the npz layout of GaussianAvatars and VHAP."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from carigs.errors import InputError
from carigs.head.model import N_SHAPE, HeadModel
from carigs.head.teeth import FLAME_COUNTS, FLAME_WITH_TEETH_COUNTS, TEETH_COUNTS
from carigs.readers.arrays import checked_array
from carigs.readers.npz import read_npz


@dataclass(frozen=True)
class HeadParameters:
    """FLAME parameters of one frame; rotations are axis-angle vectors in radians, lengths in metres."""

    translation: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    rotation: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """Of the whole head, about the root joint."""
    neck: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    jaw: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    eyes: Float[np.ndarray, "6"] = field(default_factory=lambda: np.zeros(6))
    """Left eye, then right eye."""
    shape: Float[np.ndarray, "300"] = field(default_factory=lambda: np.zeros(N_SHAPE))
    """Coefficients of the identity blendshapes."""
    expression: Float[np.ndarray, "100"] = field(default_factory=lambda: np.zeros(100))
    """Coefficients of the expression blendshapes."""
    static_offset: Float[np.ndarray, "v 3"] | None = None
    """Added to the shaped template."""

    @classmethod
    def load(cls, file: str | Path, model: HeadModel) -> HeadParameters:
        """Read one frame and check it against the model.

        Args:
            file: The .npz file. A static offset without FLAME's teeth does not move them.
            model: The head model.

        Returns:
            The parameters; missing trailing coefficients are 0.

        Raises:
            InputError: If the file is missing or cannot be read, or an array is missing, of another shape, or not
                finite.
        """
        file = Path(file)
        arrays = read_npz(file, "head parameter file")

        def take(key: str, size: int, *, at_most: bool = False) -> np.ndarray:
            value = checked_array(arrays, key, None, np.float64, file=file).reshape(-1)
            if value.size != size and not (at_most and 0 < value.size < size):
                raise InputError(f"{value.size} values, expected {size}", file=file, field=key)
            return np.pad(value, (0, size - value.size))

        offset, v = None, len(model.v_template)
        if "static_offset" in arrays:
            offset = checked_array(arrays, "static_offset", None, np.float64, file=file)
            if v == FLAME_WITH_TEETH_COUNTS[0] and offset.shape[-2:] == (FLAME_COUNTS[0], 3):
                offset = np.concatenate([offset.reshape(-1, 3), np.zeros((TEETH_COUNTS[0], 3))])
            if offset.shape[-2:] != (v, 3) or offset.size != v * 3:
                raise InputError(f"shape {offset.shape}, the model has {v} vertices", file=file, field="static_offset")
            offset = offset.reshape(v, 3)
        return cls(
            translation=take("translation", 3),
            rotation=take("rotation", 3),
            neck=take("neck_pose", 3),
            jaw=take("jaw_pose", 3),
            eyes=take("eyes_pose", 6),
            shape=take("shape", N_SHAPE, at_most=True),
            expression=take("expr", model.shapedirs.shape[2] - N_SHAPE, at_most=True),
            static_offset=offset,
        )

    def save(self, file: str | Path, model: HeadModel) -> None:
        """Write the npz layout that `load` and the tools of GaussianAvatars read.

        Args:
            file: File to create or replace.
            model: The head model, for the shape of a missing static offset.
        """
        offset = np.zeros(model.v_template.shape) if self.static_offset is None else self.static_offset
        np.savez(
            file,
            translation=self.translation[None].astype(np.float32),
            rotation=self.rotation[None].astype(np.float32),
            neck_pose=self.neck[None].astype(np.float32),
            jaw_pose=self.jaw[None].astype(np.float32),
            eyes_pose=self.eyes[None].astype(np.float32),
            shape=self.shape.astype(np.float32),
            expr=self.expression[None].astype(np.float32),
            static_offset=offset[None].astype(np.float32),
        )
