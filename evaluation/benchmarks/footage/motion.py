"""A person who talks: visemes, blinks, gaze, brows, and a head that turns at the neck above a body that nearly rests.

Times of visemes and blinks fall on frames, so that closed lips, wide-open mouths and closed lids are seen.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator
from scipy.spatial.transform import Rotation

from carigs.head import HeadParameters, flame_joints
from carigs.toy.rig import expressions

SECONDS = 10.0
"""Length for which `TURNS` are written; they are stretched to that of the motion."""
TURNS = (
    (0.0, 0.0, 0.0), (1.2, 0.05, 0.1), (2.5, 1.0, 0.15), (3.0, 1.0, 0.0), (4.4, -1.0, -0.1), (5.0, -1.0, 0.1),
    (6.0, 0.0, 0.0), (6.8, 0.05, 1.0), (7.6, -0.05, -1.0), (8.3, 0.0, 0.0), (9.1, 0.45, 0.4), (10.0, -0.3, -0.3),
)  # fmt: skip
"""Second, yaw and pitch as shares of the most on that side."""
VISEMES: dict[str, dict[str, float]] = {
    "rest": {},
    "m": {"lips_press": 0.5},
    "f": {"lips_press": 0.2, "upper_lip_up": 0.25},
    "a": {"jaw": 0.28, "lower_lip_down": 0.25},
    "e": {"jaw": 0.12, "mouth_stretch": 0.4},
    "i": {"jaw": 0.05, "mouth_smile": 0.45, "mouth_stretch": 0.3},
    "o": {"jaw": 0.15, "mouth_pucker": 0.7},
    "u": {"jaw": 0.05, "mouth_pucker": 1.0},
}
"""Angle of the jaw in radians, and expressions of both sides."""
FIRST_WORD = ("m", "a", "m", "a", "o", "i")
BLINK = ((-0.12, 0.0), (-0.04, 1.0), (0.04, 1.0), (0.12, 0.0))
"""Seconds from its middle, and how far the lids are closed: 200 ms from half to half."""
STEADY_GAZE = 0.5
"""Share of the head's turn by which the eyes turn back."""
MOST_GAZE = np.radians((14.0, 22.0))
"""Down or up, and to a side."""


@dataclass(frozen=True)
class Talk:
    """What the person does."""

    seconds: float = 10.0
    fps: float = 25.0
    yaw: tuple[float, float] = (-35.0, 35.0)
    """Degrees, to the person's right (below 0) and left."""
    pitch: tuple[float, float] = (-12.0, 20.0)
    """Degrees, up (below 0) and down."""
    mouth: float = 1.0
    """Strength of the visemes; 0 keeps the mouth closed."""
    blinks: bool = True
    seed: int = 0

    @property
    def count(self) -> int:
        """Number of frames."""
        return max(round(self.seconds * self.fps), 1)


def talking(talk: Talk, shape: Float[np.ndarray, " i"]) -> list[HeadParameters]:
    """Head parameters of a person of the toy's head model who talks and turns.

    Args:
        talk: What the person does.
        shape: Identity coefficients.

    Returns:
        The parameters of each frame.
    """
    rng = np.random.default_rng([talk.seed, 0x7A1C])
    count = talk.count
    angles = np.radians(turns(talk, rng))
    head = Rotation.from_euler("YXZ", angles)
    body = Rotation.from_euler("YXZ", np.radians(_wander(rng, talk, 2.0, 3) * (1.5, 1.0, 0.7)))
    neck = (body.inv() * head).as_rotvec()
    translations = _wander(rng, talk, 1.5, 3) * (0.004, 0.002, 0.004)
    code = _expressions(talk, rng)
    jaw = code.pop("jaw")
    looks = _gaze(talk, rng) - STEADY_GAZE * angles[:, [1, 0]]
    looks = MOST_GAZE * np.tanh(looks / MOST_GAZE)
    lids = {
        "eye_blink": np.maximum(code["eye_blink"], 0.9 * looks[:, 0].clip(0)),
        "eye_wide": 1.5 * (-looks[:, 0]).clip(0),
    }
    columns = np.zeros((count, 100))
    for name, weights in (code | lids).items():
        columns[:, _both_sides(name)] += weights[:, None]
    rotations = body.as_rotvec()
    return [
        HeadParameters(
            translation=translations[t],
            rotation=rotations[t],
            shape=shape,
            expression=columns[t],
            joints=flame_joints(neck=neck[t], jaw=[jaw[t], 0, 0], left_eye=[*looks[t], 0], right_eye=[*looks[t], 0]),
        )
        for t in range(count)
    ]


def turns(talk: Talk, rng: np.random.Generator) -> Float[np.ndarray, "t 3"]:
    """Yaw, pitch and roll of the head: both sides, up and down, so that the extremes are reached.

    Args:
        talk: What the person does.
        rng: Gives times and small turns.

    Returns:
        Degrees: to the person's left, down, and towards the left shoulder; the head is turned by roll first.
    """
    times, yaw, pitch = np.array(TURNS).T
    times = times * (talk.seconds / SECONDS)
    times[1:-1] += rng.uniform(-0.15, 0.15, len(times) - 2) * (talk.seconds / SECONDS)
    shares = PchipInterpolator(times, np.stack([yaw * rng.choice([-1, 1]), pitch], axis=1))(_times(talk))
    (right, left), (up, down) = talk.yaw, talk.pitch
    middle = np.array([left + right, 0.0]) / 2  # of a range on one side, the middle is the rest
    if left > 0 > right:
        middle[0] = 0.0
    ends = np.where(shares > 0, np.array([left, down]) - middle, middle - np.array([right, up]))
    return np.column_stack([middle + shares * ends, 4.0 * _wander(rng, talk, 1.3, 1)])


def _expressions(talk: Talk, rng: np.random.Generator) -> dict[str, Float[np.ndarray, " t"]]:
    """Weights of expressions over time, and the angle of the jaw."""
    times = _times(talk)
    moments, spoken = zip(*_visemes(talk, rng), strict=True)
    weights = {}
    for name in {name for viseme in VISEMES.values() for name in viseme}:
        strength = [talk.mouth * VISEMES[viseme].get(name, 0.0) for viseme in spoken]
        weights[name] = PchipInterpolator(moments, strength)(times)
    weights["mouth_smile"] = weights["mouth_smile"] + talk.mouth * 0.12 * (1 + _wander(rng, talk, 2.5, 1)[:, 0])
    brows = _wander(rng, talk, 0.9, 2)
    weights["brow_inner_up"] = 0.8 * brows[:, 0].clip(0)
    weights["brow_outer_up"] = 0.7 * (0.7 * brows[:, 0] + 0.3 * brows[:, 1]).clip(0)
    weights["brow_down"] = 0.6 * (-brows[:, 0]).clip(0)
    weights["eye_blink"] = np.zeros(len(times))
    for middle in _blinks(talk, rng):
        offsets, closed = np.array(BLINK).T
        weights["eye_blink"] = np.maximum(weights["eye_blink"], np.interp(times - middle, offsets, closed))
    return weights


def _visemes(talk: Talk, rng: np.random.Generator) -> Iterator[tuple[float, str]]:
    """Times that are those of frames, and what is spoken: words, and pauses with closed lips."""
    frame = max(round(0.2 * talk.fps), 1)
    yield -1.0, "rest"
    word, others = FIRST_WORD, [name for name in VISEMES if name != "rest"]
    while frame < talk.count:
        for viseme in word:
            yield frame / talk.fps, viseme
            frame += max(round(rng.uniform(0.14, 0.24) * talk.fps), 1)
        yield frame / talk.fps, "rest"
        frame += max(round(rng.uniform(0.1, 0.5) * talk.fps), 1)
        word = tuple(rng.choice(others, rng.integers(3, 7)))
    yield frame / talk.fps, "rest"


def _blinks(talk: Talk, rng: np.random.Generator) -> Iterator[float]:
    """Times of the middles, which are those of frames."""
    time = 0.8
    while talk.blinks and time < talk.seconds:
        yield round(time * talk.fps) / talk.fps
        time += rng.uniform(1.5, 3.0)


def _gaze(talk: Talk, rng: np.random.Generator) -> Float[np.ndarray, "t 2"]:
    """Radians down and to the left: the eyes jump, and rest."""
    jumps = np.cumsum(rng.uniform(0.4, 1.4, int(talk.seconds / 0.4) + 2))
    targets = rng.uniform(-1, 1, (len(jumps) + 1, 2)) * np.radians((7.0, 14.0))
    return targets[np.searchsorted(jumps, _times(talk))]


def _wander(rng: np.random.Generator, talk: Talk, seconds: float, columns: int) -> Float[np.ndarray, "t k"]:
    """Smooth random curves from -1 to 1 with so many seconds from one extreme to the next."""
    count = max(int(np.ceil(talk.seconds / seconds)) + 1, 2)
    return PchipInterpolator(seconds * np.arange(count), rng.uniform(-1, 1, (count, columns)))(_times(talk))


def _times(talk: Talk) -> Float[np.ndarray, " t"]:
    return np.arange(talk.count) / talk.fps


def _both_sides(name: str) -> list[int]:
    sides = name, f"{name}_left", f"{name}_right"
    return [column for column, expression in enumerate(expressions.NAMES) if expression in sides]
