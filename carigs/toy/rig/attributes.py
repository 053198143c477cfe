"""Random attributes of a person: identity coefficients, colours, hair style."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from carigs.head.model_arrays import FLAME_NUM_IDENTITY
from carigs.toy.rig import identity

Colour = tuple[float, float, float]

_SKIN = np.array([[0.90, 0.74, 0.66], [0.84, 0.65, 0.54], [0.74, 0.54, 0.42], [0.58, 0.40, 0.30], [0.42, 0.28, 0.21]])
_HAIR = np.array([[0.10, 0.08, 0.07], [0.20, 0.13, 0.09], [0.34, 0.22, 0.13], [0.52, 0.36, 0.20], [0.46, 0.21, 0.10]])
_IRIS = np.array([[0.30, 0.17, 0.08], [0.36, 0.26, 0.12], [0.28, 0.36, 0.22], [0.30, 0.44, 0.56], [0.38, 0.46, 0.50]])
_STYLES = ("side_part", "swept_back", "crop")


@dataclass(frozen=True)
class Attributes:
    """Everything that differs between two people; colours are sRGB values in [0, 1]."""

    seed: int
    shape: Float[np.ndarray, "300"]
    """Identity coefficients, in standard deviations."""
    skin: Colour
    lips: Colour
    redness: float
    freckles: float
    stubble: float
    """Strengths of these; 0: none."""
    hair: Colour
    style: str
    hair_length: float
    """Length of the longest strands, in millimetres."""
    brows: float
    """Density of the eyebrows; 1 is average."""
    iris: Colour


def sample_attributes(seed: int) -> Attributes:
    """Draw the attributes of a person.

    Args:
        seed: Equal seeds give equal people.

    Returns:
        The attributes.
    """
    rng = np.random.default_rng([seed, 0x80D])
    shape = np.zeros(FLAME_NUM_IDENTITY)
    shape[: len(identity.NAMES)] = 1.1 * rng.standard_normal(len(identity.NAMES)).clip(-1.8, 1.8)
    tone = rng.beta(1.2, 2.0) * (len(_SKIN) - 1.001)
    skin = _interpolated(_SKIN, tone)
    dark = tone / (len(_SKIN) - 1)
    hair = _HAIR[0] * 1.1 if dark > 0.6 else _interpolated(_HAIR, rng.uniform(0, len(_HAIR) - 1.001))
    iris = _IRIS[0] if dark > 0.55 else _IRIS[rng.integers(len(_IRIS))]
    red = np.array([0.80, 0.42, 0.40]) if dark < 0.6 else np.array([0.55, 0.28, 0.26])
    lips = 0.45 * skin + 0.55 * red + rng.uniform(-0.03, 0.03, 3)
    return Attributes(
        seed=seed,
        shape=shape,
        skin=_colour(skin),
        lips=_colour(lips),
        redness=float(rng.uniform(0.6, 1.2) * (1 - 0.5 * dark)),
        freckles=float(max(rng.uniform(-0.6, 1.0), 0.0) * (1 - dark)),
        stubble=float(max(rng.uniform(-0.7, 0.9), 0.0)),
        hair=_colour(hair),
        style=_STYLES[rng.integers(len(_STYLES))],
        hair_length=float(rng.uniform(32, 52)),
        brows=float(rng.uniform(0.75, 1.25)),
        iris=_colour(iris * rng.uniform(0.85, 1.15)),
    )


def _interpolated(palette: np.ndarray, position: float) -> np.ndarray:
    i = int(position)
    return palette[i] + (position - i) * (palette[i + 1] - palette[i])


def _colour(values: np.ndarray) -> Colour:
    return tuple(float(v) for v in np.clip(values, 0, 1))
