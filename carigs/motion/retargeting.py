"""A motion of one head for another one.

Expressions go by their names where both heads have names for the same facial actions, else by how they move the face
(`displacement_map`). Joints go by their names. The head moves relative to its rest: the driver's turn from its own rest
is applied to the rest of the other head.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from carigs.errors import CarigsWarning, MeshError, SettingsError
from carigs.head import HeadModel, HeadParameters
from carigs.motion.displacement_map import LandmarkActions, displacement_map, landmark_actions, shipped_actions
from carigs.motion.facial_actions import actions, name_map
from carigs.motion.motion import Motion

FULL_GAZE = np.radians(30.0)
"""Angle of an eye at which eyeLook... is 1."""
FULL_JAW = 0.3
"""Angle of the jaw in radians at which jawOpen is 1, for heads that have only one of the two."""
SIDEWAYS_JAW = 0.1
"""Angle of the jaw at which jawLeft is 1."""
EASE = 1.0
"""How far a coefficient can go beyond those of the capture."""
FAR = 0.3
"""Distance from the coefficients of the capture that is reported."""
JAW_ACTIONS = {"jaw_open": (0, FULL_JAW), "jaw_left": (1, SIDEWAYS_JAW), "jaw_right": (1, -SIDEWAYS_JAW)}
"""Axis and angle of the joint `jaw` for expressions."""
GAZE_ACTIONS = {
    f"{side}_eye": {
        f"eye_look_up_{side}": (0, -1), f"eye_look_down_{side}": (0, 1),
        f"eye_look_out_{side}": (1, outwards), f"eye_look_in_{side}": (1, -outwards),
    }
    for side, outwards in (("left", 1), ("right", -1))
}  # fmt: skip
"""Axis and sign of the rotation of each eye for expressions: down about +x, to the person's left about +y."""


@dataclass(frozen=True)
class Retargeting:
    """Maps the motion of a driver to a head.

    Attributes:
        head: The head.
        rest: Its parameters at rest.
        low: Least coefficient of each expression in its capture.
        high: Greatest coefficient.
        driver: Head model of the driver; None where names suffice.
    """

    head: HeadModel
    rest: HeadParameters
    low: Float[np.ndarray, " e"]
    high: Float[np.ndarray, " e"]
    driver: HeadModel | None = None

    @classmethod
    def to_frames(
        cls, head: HeadModel, frames: Sequence[HeadParameters], driver: HeadModel | None = None
    ) -> Retargeting:
        """Retargeting to a head of which frames are known.

        Args:
            head: The head.
            frames: Its frames; the head rests in the first one.
            driver: Head model of the driver; None where names suffice.

        Returns:
            The retargeting.
        """
        expressions = np.array([frame.expression for frame in frames])
        low, high = expressions.min(axis=0), expressions.max(axis=0)
        if "jaw" in head.joint_names[1:]:  # a mouth that the joint has opened was seen open, too
            opened = max(frame.joints[head.joint_names.index("jaw") - 1, 0] for frame in frames) / FULL_JAW
            for place, name in enumerate(head.expression_names):
                if actions(name) == {"jaw_open"}:
                    high[place] = max(high[place], min(opened, 1.0))
        return cls(head, frames[0], low, high, driver)

    def __call__(self, motion: Motion) -> list[HeadParameters]:
        """Map a motion.

        Args:
            motion: The motion of the driver.

        Returns:
            Parameters of the head for every frame.

        Raises:
            SettingsError: If the driver's expressions cannot be mapped.

        Warns:
            CarigsWarning: Expressions that are not mapped, and coefficients far from those of the capture.
        """
        joint_names = self.head.joint_names[1:]
        expression, jaw = self._expressions(motion)
        joints = np.zeros((len(motion), len(joint_names), 3))
        for name, rotations in motion.joints.items():
            if name in joint_names:
                joints[:, joint_names.index(name)] = rotations
        if "jaw" in joint_names:
            joints[:, joint_names.index("jaw")] += jaw
        elif "jaw" in motion.joints:
            expression = expression + self._jaw_as_expression(motion.joints["jaw"])
        for eye, by_action in GAZE_ACTIONS.items():
            if eye in joint_names and eye not in motion.joints:
                joints[:, joint_names.index(eye)] += _turned(motion, by_action) * FULL_GAZE
        expression = self._eased(expression)
        rotation, translation = self._head_pose(motion)
        return [
            replace(
                self.rest, expression=expression[t], joints=joints[t], rotation=rotation[t], translation=translation[t],
                dynamic_offset=None,
            )
            for t in range(len(motion))
        ]  # fmt: skip

    @property
    def names(self) -> list[str]:
        """Names of the head's expressions, numbers for those without."""
        known = self.head.expression_names
        return [*known, *map(str, range(len(known), self.head.num_expressions))]

    def _expressions(self, motion: Motion) -> tuple[Float[np.ndarray, "t e"], Float[np.ndarray, "t 3"]]:
        """Coefficients of the head, and rotations of its joint `jaw` that stand for expressions."""
        used = motion.expression.any(axis=0)
        drivers = [name for name, is_used in zip(motion.names, used, strict=True) if is_used]
        values = motion.expression[:, used]
        matrix, jaw = name_map(drivers, self.names), np.zeros((3, len(drivers)))
        unmapped = [i for i, name in enumerate(drivers) if not matrix[:, i].any()]
        opens = any(actions(name) & {"jaw_open"} for name in self.head.expression_names)
        for i in list(unmapped):
            found = [JAW_ACTIONS[action] for action in actions(drivers[i]) if action in JAW_ACTIONS]
            if found and not opens and "jaw" in self.head.joint_names:
                axis, angle = found[0]
                jaw[axis, i] = angle
                unmapped.remove(i)
        gaze = {action for by_action in GAZE_ACTIONS.values() for action in by_action}
        unmapped = [i for i in unmapped if not actions(drivers[i]) <= gaze or not actions(drivers[i])]
        # Numbers are principal components of one head: another head's mean something else.
        numbered = [i for i, name in enumerate(drivers) if name.isdigit()]
        named_head = any(actions(name) for name in self.head.expression_names)
        source = None
        if self.driver is not None and (numbered or len(unmapped) > len(drivers) / 2):
            source = landmark_actions(self.driver)
        elif unmapped and not named_head and not numbered:
            source = shipped_actions()
        maps = None if source is None else self._by_displacement(source, drivers)
        if maps is not None:
            matrix, jaw = maps
        elif numbered and max(int(drivers[i]) for i in numbered) >= self.head.num_expressions:
            raise SettingsError(
                f"motion: {len(motion.names)} numbered expressions, the avatar has {self.head.num_expressions}: "
                "name the driver's head model"
            )
        elif numbered:
            matrix[:, numbered] = 0
            for i in numbered:
                matrix[int(drivers[i]), i] = 1
            if named_head:
                text = "numbered expressions are taken for the avatar's own, as of the same head model"
                warnings.warn(CarigsWarning(f"motion: {text}"), stacklevel=3)
        else:
            if len(unmapped) == len(drivers) and drivers:
                raise SettingsError(
                    f"motion: the avatar has none of the expressions {', '.join(drivers[:4])}: "
                    "name the head model of the driver, by which they are transferred"
                )
            _warn([drivers[i] for i in unmapped], "expressions that the avatar does not have, left out")
        return values @ matrix.T, values @ jaw.T

    def _by_displacement(
        self, source: LandmarkActions, drivers: list[str]
    ) -> tuple[Float[np.ndarray, "e d"], Float[np.ndarray, "3 d"]] | None:
        """Matrices for the drivers' expressions, as those of a head move the face; None without landmarks on a face."""
        try:
            by_motion, by_jaw = displacement_map(source, self.head)
        except MeshError:
            if self.driver is not None:
                raise
            return None  # what is no face has joints alone
        to_source = name_map(drivers, source.names)
        gaze = {action for by_action in GAZE_ACTIONS.values() for action in by_action}
        missing = [
            n for n, column in zip(drivers, to_source.T, strict=True) if not column.any() and not actions(n) & gaze
        ]
        _warn(missing, "expressions that the driver's head does not have, left out")
        return by_motion @ to_source, by_jaw @ to_source

    def _jaw_as_expression(self, rotations: Float[np.ndarray, "t 3"]) -> Float[np.ndarray, "t e"]:
        expression = np.zeros((len(rotations), self.head.num_expressions))
        for place, name in enumerate(self.names):
            if actions(name) == {"jaw_open"}:
                expression[:, place] = np.maximum(rotations[:, 0], 0) / FULL_JAW
        return expression

    def _eased(self, expression: Float[np.ndarray, "t e"]) -> Float[np.ndarray, "t e"]:
        """Coefficients beyond those of the capture grow less and less, up to `EASE` beyond."""
        low, high = np.minimum(self.low, 0), np.maximum(self.high, 0)
        above, below = np.maximum(expression - high, 0), np.maximum(low - expression, 0)
        far = np.maximum(above, below).max(axis=0)
        named = [(name, f) for name, f in zip(self.names, far, strict=True) if f > FAR]
        named.sort(key=lambda pair: -pair[1])
        _warn([f"{name} (by {f:.2f})" for name, f in named], "coefficients beyond those of the avatar's capture, eased")
        inside = np.clip(expression, low, high)
        return inside + EASE * np.tanh(above / EASE) - EASE * np.tanh(below / EASE)

    def _head_pose(self, motion: Motion) -> tuple[Float[np.ndarray, "t 3"], Float[np.ndarray, "t 3"]]:
        """Rotation and translation of the head: the driver's in the frame of its rest, in that of the head's rest."""
        own, driver = Rotation.from_rotvec(self.rest.rotation), Rotation.from_rotvec(motion.rest_rotation)
        rotation = (own * driver.inv() * Rotation.from_rotvec(motion.rotation)).as_rotvec()
        moved = (own * driver.inv()).apply(motion.translation - motion.rest_translation)
        return rotation, self.rest.translation + moved


def own_motion(head: HeadModel, frames: Sequence[HeadParameters], fps: float) -> Motion:
    """The captured frames of a head as a motion.

    Args:
        head: The head.
        frames: Its frames.
        fps: Frames per second.

    Returns:
        The motion, at rest in the first frame.
    """
    known = head.expression_names
    used = head.expression_basis.any(axis=(0, 1)) | np.any([frame.expression != 0 for frame in frames], axis=0)
    names = [*known, *map(str, range(len(known), head.num_expressions))]
    kept = np.flatnonzero(used)
    joints = np.array([frame.joints for frame in frames])
    return Motion(
        fps, tuple(names[i] for i in kept), np.array([frame.expression[kept] for frame in frames]),
        {name: joints[:, j] for j, name in enumerate(head.joint_names[1:])},
        np.array([frame.rotation for frame in frames]), np.array([frame.translation for frame in frames]),
        frames[0].rotation, frames[0].translation,
    )  # fmt: skip


def _turned(motion: Motion, by_action: dict[str, tuple[int, int]]) -> Float[np.ndarray, "t 3"]:
    """Rotation of an eye as shares of `FULL_GAZE`."""
    turned = np.zeros((len(motion), 3))
    for place, name in enumerate(motion.names):
        for action in actions(name):
            if action in by_action:
                axis, sign = by_action[action]
                turned[:, axis] += sign * motion.expression[:, place]
    return turned


def _warn(names: Sequence[str], text: str) -> None:
    if names:
        listed = f"{', '.join(names[:6])}{' ...' if len(names) > 6 else ''}"
        warnings.warn(CarigsWarning(f"motion: {text}: {listed}"), stacklevel=3)
