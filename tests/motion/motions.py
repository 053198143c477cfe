"""A motion with everything in it, from a seed."""

from __future__ import annotations

import numpy as np

from carigs.motion import Motion

NAMES = ("jawOpen", "eyeBlinkLeft", "eyeBlinkRight", "browInnerUp", "mouthLeft", "mouthRight")


def random_motion(frames: int = 40, fps: float = 30.0, seed: int = 0, names: tuple[str, ...] = NAMES) -> Motion:
    """Coefficients in [0, 1], small smooth rotations."""
    random = np.random.default_rng(seed)

    def walk(columns: int, size: float) -> np.ndarray:
        return size * np.cumsum(random.normal(size=(frames, columns)), axis=0) / np.sqrt(frames)

    joints = {name: walk(3, 0.2) for name in ("neck", "left_eye", "right_eye")}
    return Motion(
        fps, names, random.random((frames, len(names))), joints, walk(3, 0.3), walk(3, 0.02),
        np.array([0.1, -0.2, 0.05]), np.array([0.01, 0.0, -0.01]),
    )  # fmt: skip


def largest_difference(a: Motion, b: Motion) -> float:
    """Largest difference of any number of two motions with the same columns."""
    assert len(a) == len(b) and a.names == b.names and a.joints.keys() == b.joints.keys()
    pairs = [(array, b.columns()[name]) for name, array in a.columns().items()]
    pairs += [(a.rest_rotation, b.rest_rotation), (a.rest_translation, b.rest_translation)]
    return max(float(np.abs(x - y).max(initial=0)) for x, y in pairs)
