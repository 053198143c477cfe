"""The capture studio: calibrated cameras on a spherical cap in front of the head, and ten sequences of expressions."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from carigs.capture.camera import Camera, look_at
from carigs.capture.splits import ENOUGH_CAMERAS, validation_timesteps
from carigs.head import HeadParameters, flame_joints
from carigs.settings import Toy
from carigs.toy.rig import expressions

_DISTANCE = 1.05  # metres from the cameras to the middle of the head
_MIDDLE = np.array([0.0, -0.010, 0.005])
_HALF_HEIGHT = 0.182  # metres in view above and below it
_AZIMUTH = 50.0  # degrees to either side
TEST_SEQUENCE = "EXP-2"

# The pose at the end of each sequence: weights of expressions (of both sides where no side is named) and rotation
# vectors of joints, in radians; `gaze` is (down, left).
_END_POSES: dict[str, dict[str, float | tuple[float, ...]]] = {
    "EMO-1": {"mouth_smile": 1.0, "cheek_raise": 0.8, "eye_squint": 0.4, "upper_lip_up": 0.35, "jaw": (0.06, 0, 0)},
    "EMO-2": {"mouth_frown": 0.9, "brow_inner_up": 1.0, "eye_squint": 0.2, "gaze": (0.18, -0.1), "neck": (0.10, 0, 0)},
    "EMO-3": {"brow_inner_up": 1.0, "brow_outer_up": 1.0, "eye_wide": 1.0, "jaw": (0.20, 0, 0), "mouth_pucker": 0.2},
    "EMO-4": {"brow_down": 1.0, "eye_squint": 0.5, "lips_press": 0.8, "nose_sneer": 0.6, "neck": (0.06, 0.05, 0)},
    "EXP-1": {"jaw": (0.27, 0, 0), "lower_lip_down": 0.3, "brow_outer_up": 0.4, "gaze": (-0.1, 0.1)},
    "EXP-2": {
        "mouth_smile_left": 0.9, "mouth_stretch_right": 0.5, "jaw": (0.12, 0, 0), "upper_lip_up": 0.4,
        "brow_outer_up_right": 0.9, "eye_blink_left": 0.35, "gaze": (0.0, 0.2), "neck": (-0.04, 0.08, 0.05),
    },
    "EXP-3": {"mouth_pucker": 1.0, "brow_inner_up": 0.3, "gaze": (0.0, -0.22), "neck": (0, -0.08, 0)},
    "EXP-4": {"eye_blink": 1.0, "mouth_left": 0.7, "brow_down": 0.3},
    "EXP-5": {"cheek_puff": 1.0, "lips_press": 0.6, "brow_inner_up": 0.5, "gaze": (-0.12, 0.0)},
    "EXP-6": {
        "mouth_right": 0.8, "jaw_right": 0.6, "lower_lip_down": 0.7, "eye_blink_right": 1.0, "brow_down_left": 0.6,
        "mouth_smile_right": 0.5, "jaw": (0.05, 0, 0), "neck": (0.03, 0.06, -0.05),
    },
}  # fmt: skip


@dataclass(frozen=True)
class Timestep:
    """One timestep of the capture."""

    sequence: str
    index: int
    """Within its sequence."""
    parameters: HeadParameters


def studio_cameras(settings: Toy) -> tuple[Camera, ...]:
    """Cameras at changing heights that look at the middle of the head.

    Args:
        settings: Number of cameras, size of the images.

    Returns:
        The cameras, from the subject's right to its left; lengths in metres.
    """
    count = settings.cameras
    azimuths = np.radians(np.linspace(-_AZIMUTH, _AZIMUTH, count) if count > 1 else [0.0])
    # The frontal camera is nearly level, the others alternate between below and above.
    elevations = np.radians(np.where(np.abs(azimuths) < 1e-6, 2.0, 4.0 + 12.0 * np.sin(2.4 * np.arange(count) + 0.7)))
    width, height = settings.width, settings.height
    focal = 0.5 * height / _HALF_HEIGHT * _DISTANCE
    cameras = []
    for azimuth, elevation in zip(azimuths, elevations, strict=True):
        toward = np.array([np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)])
        pose = look_at(_MIDDLE + _DISTANCE * toward, _MIDDLE)
        cameras.append(Camera(pose, focal, focal, width / 2, height / 2, width, height))
    return tuple(cameras)


def frontal_camera(cameras: tuple[Camera, ...]) -> int:
    """Index of the camera that looks at the face most directly.

    Args:
        cameras: The cameras.

    Returns:
        Index of the camera whose viewing direction is closest to -z.
    """
    return int(np.argmin([camera.camera_from_world[2, 2] for camera in cameras]))


def split_names(sequences: Sequence[str], cameras: tuple[Camera, ...]) -> list[list[str]]:
    """Divide the frames.

    Args:
        sequences: Sequence of each timestep.
        cameras: The cameras.

    Returns:
        `train`, `val` or `test` for each timestep and camera: the test sequence is `test`; of the others, the frontal
        camera is `val`, and before few cameras some timesteps.
    """
    front = frontal_camera(cameras) if len(cameras) >= ENOUGH_CAMERAS else None
    trained = [t for t, sequence in enumerate(sequences) if sequence != TEST_SEQUENCE]
    validated = validation_timesteps(trained) if front is None else set()

    def split(t: int, camera: int) -> str:
        if sequences[t] == TEST_SEQUENCE:
            return "test"
        return "val" if camera == front or t in validated else "train"

    return [[split(t, c) for c in range(len(cameras))] for t in range(len(sequences))]


def timesteps(settings: Toy, shape: Float[np.ndarray, "300"]) -> tuple[Timestep, ...]:
    """Head parameters of all timesteps: each sequence goes from nearly neutral to its end pose.

    Args:
        settings: Seed of the head motion, timesteps per sequence.
        shape: Identity coefficients of the subject.

    Returns:
        The training sequences, then the test sequence.
    """
    order = [name for name in _END_POSES if name != TEST_SEQUENCE] + [TEST_SEQUENCE]
    rng = np.random.default_rng([settings.seed, 0x5EC])
    result = []
    for sequence in order:
        rotation, translation = rng.uniform(-1, 1, (2, 3)) * [0.10, 0.16, 0.05], rng.uniform(-0.003, 0.003, (2, 3))
        for k in range(settings.steps_per_sequence):
            t = (k + 1) / settings.steps_per_sequence
            parameters = HeadParameters(
                translation=(1 - t) * translation[0] + t * translation[1],
                rotation=(1 - t) * rotation[0] + t * rotation[1],
                shape=shape,
                **_pose(_END_POSES[sequence], 0.5 - 0.5 * np.cos(np.pi * t)),
            )
            result.append(Timestep(sequence, k, parameters))
    return tuple(result)


def _pose(end: dict[str, float | tuple[float, ...]], amount: float) -> dict[str, np.ndarray]:
    """Rotation vectors of the joints and weights of the expressions at a share of an end pose."""
    code = np.zeros(100)
    down, left = amount * np.asarray(end.get("gaze", (0, 0)), float)
    for name, weight in ((name, weight) for name, weight in end.items() if isinstance(weight, float)):
        for i, expression in enumerate(expressions.NAMES):
            if expression in (name, f"{name}_left", f"{name}_right"):
                code[i] = amount * weight
    # The lids follow the gaze.
    for side in ("left", "right"):
        code[expressions.NAMES.index(f"eye_blink_{side}")] += 0.9 * max(down, 0.0)
        code[expressions.NAMES.index(f"eye_wide_{side}")] += 2.0 * max(-down, 0.0)
    neck, jaw = (amount * np.asarray(end.get(name, np.zeros(3)), float) for name in ("neck", "jaw"))
    gaze_vector = np.array([down, left, 0.0])
    joints = flame_joints(neck=neck, jaw=jaw, left_eye=gaze_vector, right_eye=gaze_vector)
    return {"joints": joints, "expression": code}
