"""The studio: calibrated cameras on a frontal cap, and ten short sequences of expressions."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from carigs.capture.camera import Camera, look_at
from carigs.head import HeadParameters
from carigs.settings import Toy
from carigs.toy.rig import expressions

DISTANCE = 1.05  # metres from the cameras to the middle of the head
_MIDDLE = np.array([0.0, -0.010, 0.005])
_HALF_HEIGHT = 0.182  # metres shown above and below it
_AZIMUTH = 50.0  # degrees to either side
TEST_SEQUENCE = "EXP-2"

# What each sequence works up to: weights of expressions (both sides at once where no side is named) and, under joint
# names, rotation vectors in radians; `gaze` is (down, left).
_ACTS: dict[str, dict[str, float | tuple[float, ...]]] = {
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
class Step:
    """One timestep of the capture."""

    sequence: str
    step: int
    """Within its sequence."""
    parameters: HeadParameters


def cameras(settings: Toy) -> tuple[Camera, ...]:
    """Cameras from the subject's right to its left, at changing heights; all look at the middle of the head."""
    count = settings.cameras
    azimuths = np.radians(np.linspace(-_AZIMUTH, _AZIMUTH, count) if count > 1 else [0.0])
    # The most frontal camera looks straight, the others alternate between below and above.
    elevations = np.radians(np.where(np.abs(azimuths) < 1e-6, 2.0, 4.0 + 12.0 * np.sin(2.4 * np.arange(count) + 0.7)))
    focal = 0.5 * settings.height / _HALF_HEIGHT * DISTANCE
    rig = []
    for azimuth, elevation in zip(azimuths, elevations, strict=True):
        toward = np.array([np.cos(elevation) * np.sin(azimuth), np.sin(elevation), np.cos(elevation) * np.cos(azimuth)])
        rig.append(
            Camera(
                camera_from_world=look_at(_MIDDLE + DISTANCE * toward, _MIDDLE),
                fx=focal,
                fy=focal,
                cx=settings.width / 2,
                cy=settings.height / 2,
                width=settings.width,
                height=settings.height,
            )
        )
    return tuple(rig)


def frontal_camera(rig: tuple[Camera, ...]) -> int:
    """Index of the camera whose axis is nearest to the direction the face looks in."""
    return int(np.argmin([camera.camera_from_world[2, 2] for camera in rig]))


def steps(settings: Toy, shape: Float[np.ndarray, "300"]) -> tuple[Step, ...]:
    """All timesteps: the training sequences, then the test sequence."""
    order = [name for name in _ACTS if name != TEST_SEQUENCE] + [TEST_SEQUENCE]
    rng = np.random.default_rng([settings.seed, 0x5EC])
    result = []
    for sequence in order:
        turn, shift = rng.uniform(-1, 1, (2, 3)) * [0.10, 0.16, 0.05], rng.uniform(-0.003, 0.003, (2, 3))
        for k in range(settings.steps_per_sequence):
            t = (k + 1) / settings.steps_per_sequence
            amount = 0.5 - 0.5 * np.cos(np.pi * t)  # from nearly neutral to the full act
            wander = (1 - t) * turn[0] + t * turn[1]
            result.append(Step(sequence, k, _act(sequence, amount, shape, wander, (1 - t) * shift[0] + t * shift[1])))
    return tuple(result)


def _act(
    sequence: str, amount: float, shape: np.ndarray, rotation: np.ndarray, translation: np.ndarray
) -> HeadParameters:
    code = np.zeros(100)
    joints = {"jaw": np.zeros(3), "neck": np.zeros(3)}
    gaze = np.zeros(2)
    for name, value in _ACTS[sequence].items():
        if name in joints:
            joints[name] = amount * np.asarray(value, float)
        elif name == "gaze":
            gaze = amount * np.asarray(value, float)
        else:
            for i, expression in enumerate(expressions.NAMES):
                if expression in (name, f"{name}_left", f"{name}_right"):
                    code[i] = amount * value
    # The lids go with the gaze.
    for side in ("left", "right"):
        code[expressions.NAMES.index(f"eye_blink_{side}")] += 0.9 * max(gaze[0], 0.0)
        code[expressions.NAMES.index(f"eye_wide_{side}")] += 2.0 * max(-gaze[0], 0.0)
    eye = np.array([gaze[0], gaze[1], 0.0])
    return HeadParameters(
        translation=translation,
        rotation=rotation,
        neck=joints["neck"],
        jaw=joints["jaw"],
        eyes=np.concatenate([eye, eye]),
        shape=shape,
        expression=code,
    )
