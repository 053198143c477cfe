"""The controls of the viewer, their values, and the history of the values."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from carigs.errors import SettingsError
from carigs.head import HeadParameters
from carigs.library import HeadAvatar
from carigs.mesh.triangle_mesh import components, face_areas

BEYOND = 1.5
"""End of the sliders of levels over the highest level of the avatar."""
EXPRESSIONS = 10
"""Number of expression sliders."""
NAMED_RANGE, NUMBERED_RANGE = 1.0, 2.0
"""Ranges of the coefficients of blendshapes with names (as ICT's, in [0, 1]) and of principal components (FLAME's)."""
JOINT_AXES = {"neck": "xyz", "jaw": "xyz", "eyes": "xy"}
"""Axes of the joints' sliders. Around x the head nods, the jaw opens, the eyes look down; around y they turn left."""
JOINT_DEGREES = {"neck": 40.0, "jaw": 30.0, "eyes": 35.0}
"""Largest angles of the joints' sliders in degrees."""
EYES = ("left_eye", "right_eye")
MERGED_SECONDS = 1.0
"""Changes of one control within this time are one step of undo."""
STEPS = 200
"""Steps that undo remembers."""

Values = Mapping[str, float]
"""Value of each control by name. All controls but `frame` are 0 for the natural head as it was captured."""


class Control(NamedTuple):
    """One slider."""

    name: str
    label: str
    group: str
    """`exaggeration`, `regions`, `time`, `expression` or `joints`."""
    low: float
    high: float
    step: float


def controls_of(avatar: HeadAvatar) -> tuple[Control, ...]:
    """The sliders of an avatar.

    Args:
        avatar: The avatar.

    Returns:
        The controls, in the order of the page. `frame` is the position of a timestep among `avatar.timesteps`.
    """
    low, high = sorted((0.0, BEYOND * avatar.gamma))
    step = abs(avatar.gamma) / 100
    controls = [Control("level", "gamma", "exaggeration", low, high, step)]
    controls += [Control(f"region:{name}", name, "regions", low, high, step) for name in _skin_regions(avatar)]
    controls.append(Control("frame", "timestep", "time", 0, len(avatar.timesteps) - 1, 1))
    named = len(avatar.avatar.sequence.head.expression_names)
    for i, name in enumerate(avatar.expressions[:EXPRESSIONS]):
        end = NAMED_RANGE if i < named else NUMBERED_RANGE
        controls.append(Control(f"expression:{i}", name, "expression", -end, end, end / 100))
    for joint, axes in JOINT_AXES.items():
        if not set(EYES if joint == "eyes" else [joint]) <= set(avatar.joints):
            continue
        end = JOINT_DEGREES[joint]
        controls += [Control(f"{joint}:{axis}", f"{joint} {axis}", "joints", -end, end, 1.0) for axis in axes]
    return tuple(controls)


def _skin_regions(avatar: HeadAvatar) -> list[str]:
    """Regions with a vertex of the skin, the largest component; eyeballs and teeth follow it and have no path."""
    head = avatar.avatar.sequence.head
    labels = components(head.faces, len(head.v_template))
    areas = np.bincount(labels[head.faces[:, 0]], face_areas(head.v_template.astype(np.float64), head.faces))
    is_skin = labels == areas.argmax()
    return [name for name in avatar.regions if is_skin[head.vertex_region(name)].any()]


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


def parameters_of(avatar: HeadAvatar, values: Values) -> HeadParameters:
    """Head parameters: those of the timestep, with the sliders added.

    Args:
        avatar: The avatar.
        values: Values of the controls. Those of expressions and joints that the avatar lacks have no effect.

    Returns:
        The parameters. Angles of the sliders are added to the rotation vectors of the joints.
    """
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
