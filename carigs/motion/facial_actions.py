"""Names of facial actions: ARKit's 52 coefficients, and what heads and programs call the same.

An expression is a set of actions, each of one side where the face has two. ARKit's `browInnerUp` is two actions,
`brow_inner_up_left` and `brow_inner_up_right`, which ICT-FaceKit has one by one. Left is the person's own left.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from jaxtyping import Float

ARKIT = (
    "eyeBlinkLeft", "eyeLookDownLeft", "eyeLookInLeft", "eyeLookOutLeft", "eyeLookUpLeft", "eyeSquintLeft",
    "eyeWideLeft", "eyeBlinkRight", "eyeLookDownRight", "eyeLookInRight", "eyeLookOutRight", "eyeLookUpRight",
    "eyeSquintRight", "eyeWideRight", "jawForward", "jawRight", "jawLeft", "jawOpen", "mouthClose", "mouthFunnel",
    "mouthPucker", "mouthRight", "mouthLeft", "mouthSmileLeft", "mouthSmileRight", "mouthFrownLeft", "mouthFrownRight",
    "mouthDimpleLeft", "mouthDimpleRight", "mouthStretchLeft", "mouthStretchRight", "mouthRollLower", "mouthRollUpper",
    "mouthShrugLower", "mouthShrugUpper", "mouthPressLeft", "mouthPressRight", "mouthLowerDownLeft",
    "mouthLowerDownRight", "mouthUpperUpLeft", "mouthUpperUpRight", "browDownLeft", "browDownRight", "browInnerUp",
    "browOuterUpLeft", "browOuterUpRight", "cheekPuff", "cheekSquintLeft", "cheekSquintRight", "noseSneerLeft",
    "noseSneerRight", "tongueOut",
)  # fmt: skip
"""Apple's `ARFaceAnchor.BlendShapeLocation`, in the order of Live Link Face."""
TWO_SIDED = frozenset(
    "eye_blink eye_look_down eye_look_in eye_look_out eye_look_up eye_squint eye_wide mouth_smile mouth_frown "
    "mouth_dimple mouth_stretch mouth_press mouth_lower_down mouth_upper_up brow_down brow_inner_up brow_outer_up "
    "cheek_puff cheek_squint nose_sneer".split()
)
"""Actions of either side of the face."""
ONE_PIECE = frozenset(
    "jaw_forward jaw_left jaw_right jaw_open mouth_close mouth_funnel mouth_pucker mouth_left mouth_right "
    "mouth_roll_lower mouth_roll_upper mouth_shrug_lower mouth_shrug_upper tongue_out".split()
)
"""Actions of the whole face; left and right are directions."""
OTHER_NAMES = {
    "cheek_raise": "cheek_squint",
    "upper_lip_up": "mouth_upper_up",
    "lower_lip_down": "mouth_lower_down",
    "lips_press": "mouth_press",
    "lip_press": "mouth_press",
    "smile": "mouth_smile",
    "blink": "eye_blink",
}
"""What the procedural head and people call actions, and ARKit's name."""
SUBSTITUTES = {
    "mouth_funnel": {"mouth_pucker": 1.0, "jaw_open": 0.2}
    | {f"{lip}_{side}": 1.0 for lip in ("mouth_upper_up", "mouth_lower_down") for side in ("left", "right")},
    **{f"mouth_roll_{lip}": {"mouth_press_left": 0.5, "mouth_press_right": 0.5} for lip in ("lower", "upper")},
    **{f"mouth_dimple_{side}": {f"mouth_smile_{side}": 0.5} for side in ("left", "right")},
    **{f"eye_look_down_{side}": {f"eye_blink_{side}": 0.3} for side in ("left", "right")},
}
"""What a head does that lacks an action: about what least squares finds for ICT-FaceKit's on the procedural head
(`displacement_map`)."""
SIDES = {"l": "left", "r": "right", "left": "left", "right": "right"}
OPPOSITE = {"left": "right", "right": "left"}
PARTS = {
    "eye": "eyes",
    "brow": "brows",
    "mouth": "mouth",
    "jaw": "jaw",
    "cheek": "cheeks",
    "nose": "cheeks",
    "tongue": "mouth",
}
"""Part of the face by the first word of an action."""


@lru_cache(maxsize=4096)
def actions(name: str) -> frozenset[str]:
    """The facial actions of an expression.

    Args:
        name: Its name in any spelling: `eyeBlinkLeft`, `EyeBlinkLeft`, `eyeBlink_L`, `eye_blink_left`.

    Returns:
        Names in lower case with underscores, those of two-sided actions with their side; none for an unknown name.

    Example:
        >>> sorted(actions("browInnerUp"))
        ['brow_inner_up_left', 'brow_inner_up_right']
    """
    words = re.sub(r"(?<=[a-z0-9])(?=[A-Z])", "_", name.strip()).lower().split("_")
    words = [word for word in words if word]
    whole = "_".join(words)
    if (known := OTHER_NAMES.get(whole, whole)) in ONE_PIECE:
        return frozenset([known])
    if known in TWO_SIDED:
        return frozenset([f"{known}_left", f"{known}_right"])
    if words and words[-1] in SIDES:
        stem = "_".join(words[:-1])
        if (known := OTHER_NAMES.get(stem, stem)) in TWO_SIDED:
            return frozenset([f"{known}_{SIDES[words[-1]]}"])
    return frozenset()


def opposite(action: str) -> str:
    """The same action as a mirror shows it.

    Args:
        action: One of `actions`.

    Returns:
        The action of the other side, or in the other direction.
    """
    stem, _, last = action.rpartition("_")
    return f"{stem}_{OPPOSITE[last]}" if last in OPPOSITE else action


def part(name: str) -> str:
    """Part of the face that an expression moves.

    Args:
        name: Name of the expression.

    Returns:
        `eyes`, `brows`, `mouth`, `jaw`, `cheeks`, or "" for an expression that is not known.
    """
    return PARTS.get(min(actions(name), default="").partition("_")[0], "")


def name_map(driver: Sequence[str], head: Sequence[str]) -> Float[np.ndarray, "h d"]:
    """Matrix from coefficients of a driver to those of a head, where both have names for the same actions.

    An expression of several actions takes the mean of theirs: a head with one `browInnerUp` raises it by half if the
    driver raises one brow. Names that both have are mapped as they are; actions that the head lacks by `SUBSTITUTES`.

    Args:
        driver: Names of the driver's expressions.
        head: Names of the head's expressions.

    Returns:
        The matrix.
    """
    matrix = np.zeros((len(head), len(driver)))
    possible = frozenset().union(*map(actions, head))
    of_driver = [actions(name) for name in driver]
    instead = [_substitutes(found - possible, possible) for found in of_driver]
    places = {name: place for place, name in enumerate(driver)}
    for row, name in enumerate(head):
        wanted = actions(name)
        for column, found in enumerate(of_driver):
            if name not in places and wanted:
                matrix[row, column] = len(wanted & found) / len(wanted)
            matrix[row, column] += sum(instead[column].get(action, 0.0) for action in wanted) / max(len(wanted), 1)
        if name in places:
            matrix[row, places[name]] = 1
    return matrix


def _substitutes(missing: frozenset[str], possible: frozenset[str]) -> dict[str, float]:
    """Shares of the actions of a head that stand for actions that it lacks."""
    shares: dict[str, float] = {}
    for action in sorted(missing):
        shares |= {other: share for other, share in SUBSTITUTES.get(action, {}).items() if other in possible}
    return shares
