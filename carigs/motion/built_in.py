"""Motions without a file: `idle`, a head that waits, and `talk`, a head that seems to speak.

Both are procedural: random times of blinks, glances and syllables from a seed, and sums of sines of whole periods, so
that the motion can be repeated without a jump.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from carigs.mesh.smoothstep import smoothstep
from carigs.motion.facial_actions import ARKIT
from carigs.motion.motion import Motion

SECONDS, FPS = 10.0, 30.0
DEGREE = np.pi / 180
MOUTH_SHAPES: tuple[dict[str, float], ...] = (
    {"jawOpen": 0.75, "mouthLowerDown": 0.3, "mouthUpperUp": 0.15},
    {"jawOpen": 0.38, "mouthStretch": 0.3, "mouthSmile": 0.2},
    {"jawOpen": 0.45, "mouthFunnel": 0.5, "mouthPucker": 0.2},
    {"jawOpen": 0.25, "mouthPucker": 0.6},
    {"jawOpen": 0.22, "mouthSmile": 0.35, "mouthUpperUp": 0.15},
    {"jawOpen": 0.15, "mouthLowerDown": 0.3, "mouthPress": 0.1},
)
"""Shapes of the mouth in the middle of syllables: a, e, o, u, i, and a consonant of teeth and lip."""
LIPS_CLOSED = {"mouthPress": 0.25}
"""Between words."""
SYLLABLE = 0.19
"""Seconds from one syllable to the next."""
BLINK = (0.07, 0.04, 0.14)
"""Seconds in which the lids close, stay closed and open (Evinger et al. 1991)."""


def idle(seconds: float = SECONDS, fps: float = FPS, seed: int = 0) -> Motion:
    """A head that waits: blinks, glances, and small movements of neck, brows and mouth.

    Args:
        seconds: Length.
        fps: Frames per second.
        seed: Of the times.

    Returns:
        The motion, which continues from its end at its start.
    """
    t, random = np.arange(max(round(seconds * fps), 1)) / fps, np.random.default_rng(seed)
    values = _blinks(t, seconds, random) | _glances(t, seconds, random)
    values |= {f"mouthSmile{side}": 0.06 + 0.05 * _waves(t, seconds, random, 1, 3) for side in ("Left", "Right")}
    values["browInnerUp"] = np.maximum(0.06 * _waves(t, seconds, random, 2, 5), 0)
    return _motion(values, _sway(t, seconds, random, 1.0), fps)


def talk(seconds: float = SECONDS, fps: float = FPS, seed: int = 0) -> Motion:
    """A head that seems to speak: syllables in words with pauses, nods and brows on stressed ones, blinks.

    Args:
        seconds: Length.
        fps: Frames per second.
        seed: Of the syllables.

    Returns:
        The motion, which continues from its end at its start.
    """
    t, random = np.arange(max(round(seconds * fps), 1)) / fps, np.random.default_rng(seed)
    values = _blinks(t, seconds, random) | _glances(t, seconds, random, 0.6)
    names = {name for shape in (*MOUTH_SHAPES, LIPS_CLOSED) for name in shape}
    mouth = {name: np.zeros(len(t)) for name in sorted(names)}
    brows, nods, at = np.zeros(len(t)), np.zeros(len(t)), 0.25
    while at < seconds - 0.5:
        for syllable in range(random.integers(1, 5)):
            stress = 1.2 if syllable == 0 and random.random() < 0.4 else random.uniform(0.6, 1.0)
            bump = stress * _bump(t, at, 0.75 * SYLLABLE)
            for name, amount in MOUTH_SHAPES[random.integers(len(MOUTH_SHAPES))].items():
                mouth[name] = (
                    np.maximum(mouth[name], amount * bump) if name != "jawOpen" else mouth[name] + amount * bump
                )
            if stress > 1:
                brows, nods = np.maximum(brows, _bump(t, at, 0.35)), np.maximum(nods, _bump(t, at + 0.05, 0.3))
            at += SYLLABLE * random.uniform(0.85, 1.25)
            if at >= seconds - 0.4:
                break
        for name, amount in LIPS_CLOSED.items():
            mouth[name] = np.maximum(mouth[name], amount * _bump(t, at, 0.12))
        at += random.choice([0.12, 0.16, 0.5], p=[0.45, 0.35, 0.2])
    for name, value in mouth.items():
        sides = ("Left", "Right") if f"{name}Left" in ARKIT else ("",)
        values |= {f"{name}{side}": value for side in sides}
    values |= {"browInnerUp": 0.35 * brows, "browOuterUpLeft": 0.2 * brows, "browOuterUpRight": 0.2 * brows}
    neck = _sway(t, seconds, random, 1.8)
    neck[:, 0] += 3.0 * DEGREE * nods
    return _motion(values, neck, fps)


BUILT_IN: dict[str, Callable[..., Motion]] = {"idle": idle, "talk": talk}
"""Motions by name."""


def _motion(values: dict[str, np.ndarray], neck: Float[np.ndarray, "t 3"], fps: float) -> Motion:
    return Motion(fps, tuple(values), np.stack(list(values.values()), axis=1).clip(0, 1), {"neck": neck})


def _bump(t: Float[np.ndarray, " t"], centre: float, width: float) -> Float[np.ndarray, " t"]:
    """A smooth bump of height 1 that is 0 beyond a distance from its centre."""
    x = np.clip(np.abs(t - centre) / width, 0, 1)
    return (1 - x * x) ** 2


def _waves(t: np.ndarray, seconds: float, random: np.random.Generator, low: int, high: int) -> np.ndarray:
    """Sum of three sines of whole periods, from -1 to 1."""
    periods = random.integers(low, high + 1, 3) * max(round(seconds / SECONDS), 1)
    return np.mean([np.sin(2 * np.pi * (n * t / seconds + random.random())) for n in periods], axis=0)


def _sway(t: np.ndarray, seconds: float, random: np.random.Generator, size: float) -> Float[np.ndarray, "t 3"]:
    """Rotation vectors of the neck: nodding, turning, tilting."""
    degrees = [size * most * _waves(t, seconds, random, 1, 4) for most in (1.5, 3.0, 1.2)]
    return np.stack(degrees, axis=1) * DEGREE


def _blinks(t: np.ndarray, seconds: float, random: np.random.Generator) -> dict[str, np.ndarray]:
    closed, at = np.zeros(len(t)), 0.9
    while at < seconds - sum(BLINK):
        after = t - at
        falling = smoothstep(after / BLINK[0])
        rising = smoothstep((after - BLINK[0] - BLINK[1]) / BLINK[2])
        closed = np.maximum(closed, falling - rising)
        at += random.uniform(2.2, 4.5)
    return {"eyeBlinkLeft": closed, "eyeBlinkRight": closed}


def _glances(t: np.ndarray, seconds: float, random: np.random.Generator, size: float = 1.0) -> dict[str, np.ndarray]:
    """Both eyes look at points, fast from one to the next; they begin and end straight ahead."""
    yaw, pitch, at, here = np.zeros(len(t)), np.zeros(len(t)), 0.6, np.zeros(2)
    while at < seconds - 0.4:
        there = size * random.uniform([-0.22, -0.1], [0.22, 0.1]) if at < seconds - 1.6 else np.zeros(2)
        moved = smoothstep((t - at) / 0.07)
        yaw, pitch = yaw + (there[0] - here[0]) * moved, pitch + (there[1] - here[1]) * moved
        here, at = there, at + random.uniform(0.7, 1.9)
    back = smoothstep((t - (seconds - 0.35)) / 0.07)
    yaw, pitch = yaw - here[0] * back, pitch - here[1] * back
    left, right, up, down = (np.maximum(x, 0) for x in (yaw, -yaw, -pitch, pitch))
    return {
        "eyeLookOutLeft": left, "eyeLookInRight": left, "eyeLookInLeft": right, "eyeLookOutRight": right,
        "eyeLookUpLeft": up, "eyeLookUpRight": up, "eyeLookDownLeft": down, "eyeLookDownRight": down,
    }  # fmt: skip
