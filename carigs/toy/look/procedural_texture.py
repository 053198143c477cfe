"""Procedural texture: colour and gloss of skin, lips and eyes at points of the template (millimetres; sRGB values)."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float32

from carigs.mesh.smoothstep import smoothstep
from carigs.toy.rig.attributes import Attributes, Colour
from carigs.toy.rig.regions import brow_weight, ear_weight, height_above_hairline, lip_borders
from carigs.toy.shape import anatomy
from carigs.toy.shape.falloff import gaussian
from carigs.toy.shape.noise import gradient_noise, spots

_IRIS_RADIUS, _PUPIL_RADIUS = 5.9, 2.1


class _Layers:
    """Texture values (red, green, blue, gloss) that layers are added to."""

    def __init__(self, n: int, colour: Colour, gloss: float) -> None:
        self.values = np.tile(np.float32([*colour, gloss]), (n, 1))

    def tint(self, weight: np.ndarray, colour: Colour) -> None:
        """Multiply by a colour where the weight is 1."""
        self.values[:, :3] *= 1 + np.multiply.outer(weight, np.asarray(colour, np.float32) - 1)

    def cover(self, weight: np.ndarray, colour: Colour, gloss: float | None = None) -> None:
        """Replace colour and gloss where the weight is 1."""
        self.values[:, :3] += weight[:, None] * (np.asarray(colour, np.float32) - self.values[:, :3])
        if gloss is not None:
            self.values[:, 3] += weight * (gloss - self.values[:, 3])


def skin_texture(points: Float32[np.ndarray, "n 3"], attributes: Attributes) -> Float32[np.ndarray, "n 4"]:
    """Texture of the head surface: skin, lips, lids, brows, and the scalp under the hair.

    Args:
        points: Positions on the template, in millimetres.
        attributes: Colours of the person, and the seed of the noise.

    Returns:
        Red, green, blue (sRGB in [0, 1]) and gloss, the strength of the highlight.
    """
    p, seed = points, 1000 * attributes.seed
    x, y, z = p.T
    ax = np.abs(x)
    ear = ear_weight(p)
    layers = _Layers(len(p), attributes.skin, 0.055)
    tint, cover, paint = layers.tint, layers.cover, layers.values
    mottle, grain = gradient_noise(p, 22.0, 3, seed + 1), gradient_noise(p, 2.2, 3, seed + 2)
    paint[:, :3] *= 1 + np.outer(mottle, [0.035, 0.06, 0.07]) + np.outer(grain, [0.035, 0.045, 0.05])
    flush = gaussian(p, (42, -8, 72), (19, 17, 30)) + 0.9 * gaussian(p, (0, -9, 116), (13, 11, 14)) + 0.7 * ear
    flush += 0.4 * gaussian(p, (0, -76, 98), (16, 10, 20))
    tint(np.clip(attributes.redness * flush * (1 + 0.5 * mottle), 0, 1.2), (1.0, 0.80, 0.79))
    tint(gaussian(p, (32, 15, 80), (15, 6, 18)), (0.90, 0.85, 0.88))  # under the eyes
    tint(gaussian(p, (34, 37, 84), (14, 6, 20)), (0.93, 0.86, 0.85))  # upper lid
    tint(gaussian(p, (0, 78, 92), (45, 24, 40)), (1.03, 1.03, 1.02))
    tint(smoothstep((-70 - y - 0.35 * z) / 30), (0.96, 0.94, 0.93))  # neck
    paint[:, 3] += 0.05 * (gaussian(p, (0, -6, 114), (12, 22, 20)) + 0.6 * gaussian(p, (0, 75, 92), (40, 24, 40)))
    if attributes.freckles > 0:
        where = gaussian(p, (26, 0, 88), (30, 20, 40)) + 0.5 * gaussian(p, (0, 70, 90), (50, 30, 40))
        tint(np.clip(1.3 * attributes.freckles * where * spots(p, 3.2, 0.5, seed + 3), 0, 0.8), (0.74, 0.60, 0.50))
    tint(np.clip(spots(p, 16.0, 0.06, seed + 4) * 6 - 4.2, 0, 1), (0.50, 0.38, 0.32))  # a few moles
    if attributes.stubble > 0:
        beard = smoothstep((-12 - y - 0.35 * (ax - 20) + 5 * mottle) / 24) * smoothstep((z - 4) / 30)
        beard *= smoothstep((y + 118) / 30) * (1 - 0.8 * gaussian(p, (32, -20, 85), (17, 13, 34)))
        dots = 0.55 + 0.9 * np.clip(gradient_noise(p, 1.0, 1, seed + 5), -0.3, 1)
        tint(np.clip(attributes.stubble * beard * dots, 0, 0.7), (0.66, 0.66, 0.67))
    _mouth(p, attributes, layers, seed)
    _eyes(p, layers)
    brow = brow_weight(p)
    slanted = np.stack([x + 0.7 * np.abs(y), y, z], axis=1).astype(np.float32)
    strokes = gradient_noise(slanted, (1.3, 3.5, 6.0), 2, seed + 8)
    shade = tuple(np.asarray(attributes.hair) * 0.7 + 0.25 * np.asarray(attributes.skin))
    cover(np.clip(smoothstep(brow / 0.55) * attributes.brows * (0.62 + 0.5 * strokes), 0, 0.85), shade, 0.03)
    # The scalp under the hair, with a ragged edge.
    edge = height_above_hairline(p) + 5 * gradient_noise(p, 9.0, 2, seed + 9)
    under = smoothstep((edge + 1) / 12) * (1 - ear) * (ax < 82)
    cover(0.86 * under, tuple(np.asarray(attributes.hair) * 0.75 + 0.06 * np.asarray(attributes.skin)), 0.02)
    return np.clip(paint, 0, 1)


def _mouth(p: np.ndarray, attributes: Attributes, layers: _Layers, seed: int) -> None:
    tint, cover = layers.tint, layers.cover
    x, y, z = p.T
    ax = np.abs(x)
    lower, upper = lip_borders(x)
    edge = np.minimum(upper - y, y - lower) + 0.25 * gradient_noise(p, 2.5, 2, seed + 6)
    red = smoothstep((edge + 0.35) / 0.9) * smoothstep((25.0 - ax) / 1.5) * smoothstep((z - 78) / 4)
    cover(0.92 * red, attributes.lips, 0.13)
    wrinkles = gradient_noise(p, (1.1, 9.0, 9.0), 2, seed + 7)
    tint(np.clip(red * (0.35 * wrinkles), -0.3, 0.5), (0.80, 0.72, 0.72))
    tint(gaussian(p, (24, -44.3, 92), (3.5, 3.5, 9)), (0.70, 0.58, 0.56))  # corner
    line = np.abs(y - anatomy.lip_height(x))
    tint(np.exp(-((line / 1.1) ** 2)) * red, (0.62, 0.42, 0.42))
    inside = smoothstep((1.22 - anatomy.mouth_cavity(p)) / 0.1)
    inside = np.maximum(inside, (line < 0.9) * smoothstep((100.0 - z) / 3)) * (ax < 27) * (z > 50)
    cover(inside, (0.42, 0.16, 0.15), 0.05)
    cover(inside * smoothstep((-44.5 - y) / 3) * (ax < 19), (0.66, 0.33, 0.33), 0.08)  # tongue
    nostril = ((ax - 6.8) / 3.6) ** 2 + ((y + 20.5) / 6.0) ** 2 + ((z - 105) / 6.0) ** 2
    cover(smoothstep((1.25 - nostril) / 0.5) * smoothstep((-13.0 - y) / 2), (0.16, 0.07, 0.06), 0.0)
    canal = ((ax - 72) / 7) ** 2 + ((y - 9) / 5) ** 2 + ((z + 10) / 5) ** 2
    tint(smoothstep((1.2 - canal) / 0.9), (0.45, 0.32, 0.30))


def _eyes(p: np.ndarray, layers: _Layers) -> None:
    cover = layers.cover
    x, y, z = np.abs(p[:, 0]), p[:, 1], p[:, 2]
    lower, upper = anatomy.lid_margins(x)
    front = (z > anatomy.EYE_Z) & (x > 14) & (x < 50) & (np.abs(y - anatomy.EYE_Y) < 16)
    radius = anatomy.eye_distance(p)
    at_lid = front * (upper > lower - 0.6) * (radius < 18)
    rim = front * (radius < anatomy.SOCKET_RADIUS + 1.3) * (y < upper + 1) * (y > lower - 1)
    cover(rim, (0.76, 0.48, 0.44), 0.12)  # the moist margin
    fold = front * (radius < anatomy.SOCKET_RADIUS + 0.35) * ((y > upper + 0.7) | (y < lower - 0.7))
    cover(fold, (0.25, 0.12, 0.11), 0.0)
    cover(0.8 * at_lid * np.exp(-((np.abs(y - upper) / 0.75) ** 2)), (0.13, 0.08, 0.07))
    cover(0.38 * at_lid * np.exp(-((np.abs(y - lower) / 0.6) ** 2)) * smoothstep((x - 22) / 8), (0.22, 0.13, 0.11))
    behind = (z <= anatomy.EYE_Z + 1) & (radius < anatomy.SOCKET_RADIUS + 1)
    cover(behind.astype(np.float32), (0.25, 0.12, 0.11), 0.0)


def eyeball_texture(points: Float32[np.ndarray, "n 3"], attributes: Attributes) -> Float32[np.ndarray, "n 4"]:
    """Texture of an eyeball: sclera with veins, iris, pupil.

    Args:
        points: Positions relative to the centre of the eyeball, which looks along +z, in millimetres.
        attributes: Colour of the iris, and the seed of the noise.

    Returns:
        Red, green, blue (sRGB in [0, 1]) and gloss.
    """
    seed = 1000 * attributes.seed + 50
    x, y, z = points.T
    axial = np.hypot(x, y)  # distance from the optical axis
    turn = np.arctan2(y, x)
    layers = _Layers(len(points), (0.87, 0.84, 0.82), 0.35)
    paint = layers.values
    far = smoothstep((axial - 7.0) / 5.0)
    veins = np.clip(gradient_noise(points, (2.5, 1.2, 2.5), 3, seed), 0, 1)
    paint[:, :3] *= 1 + np.outer(far * (0.35 + 0.9 * veins), [-0.06, -0.24, -0.24])
    ring = np.stack([6 * np.cos(turn), 6 * np.sin(turn), 0.35 * axial], axis=1).astype(np.float32)
    fibres = gradient_noise(ring, 0.75, 2, seed + 1)
    iris = np.asarray(attributes.iris) * (1.15 + 0.55 * fibres)[:, None]
    iris *= (0.72 + 0.5 * smoothstep((axial - 2.2) / 2.5))[:, None]
    iris += np.outer(np.exp(-(((axial - 2.7) / 0.8) ** 2)), [0.10, 0.06, 0.01])
    iris *= (1 - 0.75 * smoothstep((axial - 4.7) / 1.1))[:, None]  # limbus
    inside = (smoothstep((_IRIS_RADIUS + 0.35 - axial) / 0.7) * (z > 0))[:, None]
    paint[:, :3] += inside * (iris - paint[:, :3])
    layers.cover(smoothstep((_PUPIL_RADIUS + 0.25 - axial) / 0.5) * (z > 0), (0.015, 0.015, 0.015))
    paint[:, 3] += np.where(axial < anatomy.EYE_RADIUS * 0.5, 0.25, 0.0)
    return np.clip(paint, 0, 1)
