"""Who is filmed by which cameras: `talk`, `orbit` and `three`."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from carigs.capture.camera import Camera, look_at
from carigs.head import HeadModel, HeadParameters
from carigs.toy.rig import expressions
from evaluation.benchmarks.footage.motion import Talk, talking
from evaluation.benchmarks.footage.truth import FootageTruth

DISTANCE = 0.75
"""Metres from the cameras to the middle of the head: an arm and a half."""
MIDDLE = np.array([0.0, 0.03, 0.0])
"""What cameras look at, in metres: so high that the end of the neck lies below the image."""
FOCAL = 2.05
"""Focal length in widths of the image."""
ORBIT = 60.0
"""Degrees of the camera's way to either side."""
SIDES = (-35.0, 0.0, 35.0)
"""Degrees of the three cameras, from the person's right to its left."""
STILL = {"mouth_smile_left": 0.5, "mouth_smile_right": 0.5, "brow_outer_up_left": 0.3, "brow_outer_up_right": 0.3}
"""Expression of the still person."""


def view(side: int, azimuth: float = 0.0, elevation: float = 0.0, distance: float = DISTANCE) -> Camera:
    """A camera that looks at the middle of the head.

    Args:
        side: Width and height of the image in pixels.
        azimuth: Degrees to the person's left.
        elevation: Degrees above the head.
        distance: Metres.

    Returns:
        The camera.
    """
    a, e = np.radians((azimuth, elevation))
    toward = np.array([np.cos(e) * np.sin(a), np.sin(e), np.cos(e) * np.cos(a)])
    pose = look_at(MIDDLE + distance * toward, MIDDLE)
    return Camera(pose, FOCAL * side, FOCAL * side, side / 2, side / 2, side, side)


def talk(
    model: HeadModel, shape: Float[np.ndarray, " i"], side: int, motion: Talk, distance: float = DISTANCE
) -> FootageTruth:
    """One static camera, and a person who talks and turns.

    Args:
        model: The toy's head model.
        shape: Identity coefficients of the person.
        side: Width and height of the images in pixels.
        motion: What the person does.
        distance: Metres from the camera to the middle of the head.

    Returns:
        The truth.
    """
    parameters = talking(motion, shape)
    return FootageTruth(model, parameters, [[view(side, distance=distance)] for _ in parameters], motion.fps)


def orbit(model: HeadModel, shape: Float[np.ndarray, " i"], side: int, motion: Talk) -> FootageTruth:
    """A camera that circles a still person by 120 degrees. The light stays in the room.

    Args:
        model: The toy's head model.
        shape: Identity coefficients of the person.
        side: Width and height of the images in pixels.
        motion: Length and frame rate.

    Returns:
        The truth.
    """
    expression = np.zeros(100)
    for name, weight in STILL.items():
        expression[expressions.NAMES.index(name)] = weight
    still = HeadParameters(shape=shape, expression=expression)
    way = np.linspace(-1, 1, motion.count)
    cameras = [[view(side, ORBIT * w, 5 * np.sin(2.5 * w), DISTANCE * (1 + 0.04 * np.cos(4 * w)))] for w in way]
    return FootageTruth(model, [still] * len(way), cameras, motion.fps)


def three(model: HeadModel, shape: Float[np.ndarray, " i"], side: int, motion: Talk) -> FootageTruth:
    """Three synchronised static cameras, and a person who talks and turns.

    Args:
        model: The toy's head model.
        shape: Identity coefficients of the person.
        side: Width and height of the images in pixels.
        motion: What the person does.

    Returns:
        The truth.
    """
    parameters = talking(motion, shape)
    return FootageTruth(model, parameters, [[view(side, a) for a in SIDES] for _ in parameters], motion.fps)


KINDS: dict[str, Callable[..., FootageTruth]] = {"talk": talk, "orbit": orbit, "three": three}
