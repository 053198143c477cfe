"""The controls of the viewer: a slider for everything that can be changed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from carigs.library import HeadAvatar
from carigs.mesh.triangle_mesh import components, face_areas
from carigs.motion.facial_actions import actions

BEYOND = 1.5
"""End of the sliders of levels over the highest level of the avatar."""
EXPRESSIONS = 16
"""Most sliders of expressions."""
FIRST = (
    "jaw_open", "mouth_smile_left", "mouth_smile_right", "eye_blink_left", "eye_blink_right", "brow_inner_up_left",
    "brow_inner_up_right", "brow_down_left", "brow_down_right", "mouth_pucker", "mouth_frown_left", "mouth_frown_right",
)  # fmt: skip
"""Facial actions that people look for first. Expressions that move more follow them."""
NAMED_RANGE, NUMBERED_RANGE = 1.0, 2.0
"""Ranges of the coefficients of blendshapes with names (as ICT's, in [0, 1]) and of principal components (FLAME's)."""
JOINT_AXES = {"neck": "xyz", "jaw": "xyz", "eyes": "xy"}
"""Axes of the joints' sliders. Around x the head nods, the jaw opens, the eyes look down; around y they turn left."""
JOINT_DEGREES = {"neck": 40.0, "jaw": 30.0, "eyes": 35.0}
"""Largest angles of the joints' sliders in degrees."""
EYES = ("left_eye", "right_eye")


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
    for i in first_expressions(avatar):
        name = avatar.expressions[i]
        end = NAMED_RANGE if i < named else NUMBERED_RANGE
        controls.append(Control(f"expression:{i}", name, "expression", -end, end, end / 100))
    for joint, axes in JOINT_AXES.items():
        if not set(EYES if joint == "eyes" else [joint]) <= set(avatar.joints):
            continue
        end = JOINT_DEGREES[joint]
        controls += [Control(f"{joint}:{axis}", f"{joint} {axis}", "joints", -end, end, 1.0) for axis in axes]
    return tuple(controls)


def first_expressions(avatar: HeadAvatar) -> list[int]:
    """Expressions that get a slider.

    Args:
        avatar: The avatar.

    Returns:
        Places among `avatar.expressions`: those of `FIRST`, then those that move the head most.
    """
    head = avatar.avatar.sequence.head
    size = (head.expression_basis.astype(np.float64) ** 2).sum(axis=(0, 1))
    places = [i for action in FIRST for i, name in enumerate(head.expression_names) if action in actions(name)]
    places += np.argsort(-size, kind="stable").tolist()
    return list(dict.fromkeys(places))[:EXPRESSIONS]


def _skin_regions(avatar: HeadAvatar) -> list[str]:
    """Regions with a vertex of the skin, the largest component; eyeballs and teeth follow it and have no path."""
    head = avatar.avatar.sequence.head
    labels = components(head.faces, len(head.v_template))
    areas = np.bincount(labels[head.faces[:, 0]], face_areas(head.v_template.astype(np.float64), head.faces))
    is_skin = labels == areas.argmax()
    return [name for name in avatar.regions if is_skin[head.vertex_region(name)].any()]
