"""Values of the controls of the viewer, and their history."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from carigs.errors import SettingsError
from carigs.head import HeadParameters
from carigs.library import HeadAvatar
from carigs.viewer.controls import EYES, JOINT_AXES, Control
from carigs.viewer.drives import Drive

MERGED_SECONDS = 1.0
"""Changes of one control within this time are one step of undo."""
STEPS = 200
"""Steps that undo remembers."""

MOTION = ("motion", "motion_frame")
"""Values besides those of the controls while a motion is shown: its number from 1, and its frame."""

Values = Mapping[str, float]
"""Value of each control by name. All controls but `frame` are 0 for the natural head as it was captured."""


class State:
    """Values of the controls, with undo.

    Attributes:
        controls: The controls by name.
        values: Their values.
    """

    def __init__(self, controls: tuple[Control, ...]) -> None:
        """Start with the natural head at the first timestep.

        Args:
            controls: The controls.
        """
        self.controls = {control.name: control for control in controls}
        self.values: dict[str, float] = {control.name: 0.0 for control in controls}
        self._past: list[dict[str, float]] = []
        self._future: list[dict[str, float]] = []
        self._last: tuple[str | None, float] = (None, -math.inf)

    def set(self, name: str, value: float, now: float) -> bool:
        """Change a value.

        Args:
            name: Name of the control.
            value: The value; one outside the range of the control becomes its end.
            now: Time in seconds. A change of the control that was changed last, at most `MERGED_SECONDS` ago, is the
                same step of undo.

        Returns:
            Whether anything changes.

        Raises:
            SettingsError: If there is no such control, or the value is not a finite number.
        """
        if name not in self.controls:
            raise SettingsError(f"there is no control {name}")
        if not isinstance(value, int | float) or not math.isfinite(value):
            raise SettingsError(f"{name}: expected a finite number")
        control = self.controls[name]
        value = float(min(max(value, control.low), control.high))
        if name == "frame":
            value = float(round(value))
        if value == self.values[name]:
            return False
        last_name, last_time = self._last
        if name != last_name or now - last_time > MERGED_SECONDS:
            self._remember()
        self._last = (name, now)
        self.values = {**self.values, name: value}
        return True

    def play(self, frame: int) -> None:
        """Show another timestep without a step of undo.

        Args:
            frame: Position of the timestep; taken modulo their number.
        """
        count = int(self.controls["frame"].high) + 1
        self.values = {**self.values, "frame": float(frame % count)}

    def start(self, level: float) -> None:
        """Begin at a level of exaggeration.

        Args:
            level: The level.
        """
        self.values = {**self.values, "level": level}

    def drive(self, motion: int, frame: int = 0) -> None:
        """Show a frame of a motion without a step of undo.

        Args:
            motion: Number of the motion from 1; 0 for the capture.
            frame: Its frame.
        """
        others = {name: value for name, value in self.values.items() if name not in MOTION}
        self.values = others | (dict(zip(MOTION, (float(motion), float(frame)), strict=True)) if motion else {})

    def reset(self) -> None:
        """Set all values but the timestep to 0; undo brings them back."""
        if any(value for name, value in self.values.items() if name != "frame"):
            self._remember()
            self.values = {name: value if name == "frame" else 0.0 for name, value in self.values.items()}

    def undo(self) -> bool:
        """Take the last step back.

        Returns:
            Whether there was one.
        """
        return self._step(self._past, self._future)

    def redo(self) -> bool:
        """Repeat the step that `undo` took back.

        Returns:
            Whether there was one.
        """
        return self._step(self._future, self._past)

    def _remember(self) -> None:
        self._past.append(self.values)
        del self._past[:-STEPS]
        self._future.clear()
        self._last = (None, -math.inf)

    def _step(self, source: list[dict[str, float]], target: list[dict[str, float]]) -> bool:
        if not source:
            return False
        target.append(self.values)
        self.values = source.pop()
        self._last = (None, -math.inf)
        return True


def without_exaggeration(values: Values) -> dict[str, float]:
    """The natural head in the same pose.

    Args:
        values: Values of the controls.

    Returns:
        The values with the levels of the head and of its regions at 0.
    """
    return {name: 0.0 if is_level(name) else value for name, value in values.items()}


def is_level(name: str) -> bool:
    """Whether a control is a level of exaggeration.

    Args:
        name: Name of the control.

    Returns:
        Whether it is that of the head or of a region.
    """
    return name == "level" or name.startswith("region:")


def region_levels(values: Values) -> dict[str, float]:
    """Levels of the regions that are exaggerated on their own.

    Args:
        values: Values of the controls.

    Returns:
        Levels other than 0 by the name of the region.
    """
    return {name.removeprefix("region:"): v for name, v in values.items() if name.startswith("region:") and v}


def timestep_of(avatar: HeadAvatar, values: Values) -> int:
    """The timestep that is shown.

    Args:
        avatar: The avatar.
        values: Values of the controls.

    Returns:
        The timestep; the last one of an avatar that has fewer.
    """
    timesteps = avatar.timesteps
    return timesteps[min(int(values["frame"]), len(timesteps) - 1)]


def parameters_of(avatar: HeadAvatar, values: Values, drives: Sequence[Drive] = ()) -> HeadParameters:
    """Head parameters: those of the timestep or of a frame of a motion, with the sliders added.

    Args:
        avatar: The avatar.
        values: Values of the controls. Those of expressions and joints that the avatar lacks have no effect.
        drives: Motions of the avatar.

    Returns:
        The parameters. Angles of the sliders are added to the rotation vectors of the joints.
    """
    number, frame = (int(values.get(name, 0)) for name in MOTION)
    if number:
        shown = drives[number - 1].parameters
        parameters = shown[frame % len(shown)]
    else:
        parameters = avatar.avatar.sequence.parameters[timestep_of(avatar, values)]
    expression, joints = parameters.expression.copy(), parameters.joints.copy()
    for name, value in values.items():
        kind, _, key = name.partition(":")
        if not value:
            continue
        if kind == "expression" and int(key) < len(expression):
            expression[int(key)] += value
        for joint in EYES if kind == "eyes" else [kind]:
            if kind in JOINT_AXES and joint in avatar.joints:
                joints[avatar.joints.index(joint), "xyz".index(key)] += np.radians(value)
    return replace(parameters, expression=expression, joints=joints)
