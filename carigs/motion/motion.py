"""A motion of a head over time, as a driver has it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int

from carigs.errors import SettingsError

MAX_FRAMES = 200_000
"""Most frames of a motion: an hour and 50 minutes at 30 frames a second."""
FPS_RANGE = 1.0, 1000.0
LARGEST = 1e4
"""Largest number in a motion, without its sign."""


@dataclass(frozen=True)
class Motion:
    """Expressions by name, rotations of joints, and the pose of the head, at a constant frame rate.

    Rotations are rotation vectors in radians, lengths are in metres; the axes are those of head models: x to the
    person's left, y up, z forward. Left and right are the person's own.
    """

    fps: float
    """Frames per second."""
    names: tuple[str, ...]
    """Names of the expressions, in any spelling that `carigs.motion.facial_actions` knows, or their numbers."""
    expression: Float[np.ndarray, "t e"]
    """Their coefficients."""
    joints: Mapping[str, Float[np.ndarray, "t 3"]] = field(default_factory=dict)
    """Rotations relative to the parents by joint, such as `neck`, `jaw`, `left_eye` and `right_eye`."""
    rotation: Float[np.ndarray, "t 3"] | None = None
    """Of the whole head; None for no rotation."""
    translation: Float[np.ndarray, "t 3"] | None = None
    """Of the whole head; None for none."""
    rest_rotation: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """Rotation at which the head counts as not turned."""
    rest_translation: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))
    """Its translation there."""

    def __post_init__(self) -> None:
        zeros = np.zeros((len(self.expression), 3))
        for name in ("rotation", "translation"):
            if getattr(self, name) is None:
                object.__setattr__(self, name, zeros)
        t = len(self.expression)
        if not FPS_RANGE[0] <= self.fps <= FPS_RANGE[1]:
            raise SettingsError(
                f"motion: {self.fps:g} frames per second; expected {FPS_RANGE[0]:g} to {FPS_RANGE[1]:g}"
            )
        if not 1 <= t <= MAX_FRAMES:
            raise SettingsError(f"motion: {t} frames; expected 1 to {MAX_FRAMES}")
        arrays = {"expression": self.expression, "rotation": self.rotation, "translation": self.translation}
        for name, array in (arrays | {f"joint {name}": joint for name, joint in self.joints.items()}).items():
            expected = (t, len(self.names) if name == "expression" else 3)
            if array.shape != expected:
                raise SettingsError(f"motion: {name} has the shape {array.shape}, expected {expected}")
            if not (np.abs(array) <= LARGEST).all():
                at = int(np.argwhere(~(np.abs(array) <= LARGEST))[0, 0])
                raise SettingsError(f"motion: {name} of frame {at} is not a number up to {LARGEST:g}")
        if len(set(self.names)) < len(self.names):
            raise SettingsError("motion: a name of an expression appears twice")

    def __len__(self) -> int:
        return len(self.expression)

    @property
    def seconds(self) -> float:
        """Duration."""
        return len(self) / self.fps

    def columns(self) -> dict[str, Float[np.ndarray, "t _"]]:
        """All that changes over time.

        Returns:
            `expression`, `rotation`, `translation`, and the joints as `joint NAME`.
        """
        joints = {f"joint {name}": rotations for name, rotations in self.joints.items()}
        return {"expression": self.expression, "rotation": self.rotation, "translation": self.translation} | joints

    def with_columns(self, columns: Mapping[str, Float[np.ndarray, "t _"]], fps: float | None = None) -> Motion:
        """The motion with other values, of any number of frames.

        Args:
            columns: Arrays by the names of `columns`.
            fps: Frames per second; None for those of this motion.

        Returns:
            The changed motion.
        """
        joints = {name.removeprefix("joint "): a for name, a in columns.items() if name.startswith("joint ")}
        return replace(
            self, fps=self.fps if fps is None else fps, joints=joints, expression=columns["expression"],
            rotation=columns["rotation"], translation=columns["translation"],
        )  # fmt: skip

    def frames(self, places: Int[np.ndarray, " n"]) -> Motion:
        """Some of the frames.

        Args:
            places: Their numbers, in any order.

        Returns:
            The motion of these frames.
        """
        return self.with_columns({name: array[places] for name, array in self.columns().items()})
