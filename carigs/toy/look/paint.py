"""The paint: colour and gloss of skin, lips, eyes as functions of the template point.  Millimetres, sRGB values."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from jaxtyping import Float32

from carigs.toy.rig.regions import above_hairline, brow_weight, ear_weight, lip_borders
from carigs.toy.rig.traits import Traits
from carigs.toy.shape.falloff import bump, smoothstep
from carigs.toy.shape.field import EYE_RADIUS, EYE_X, EYE_Y, EYE_Z, SOCKET_RADIUS, lid_margins, lip_line
from carigs.toy.shape.noise import fractal, spots

_IRIS_RADIUS, _PUPIL_RADIUS = 5.9, 2.1


def paint_skin(points: Float32[np.ndarray, "n 3"], traits: Traits) -> Float32[np.ndarray, "n 4"]:
    """Red, green, blue and gloss (strength of the highlight) at points of the skin."""
    p, seed = points, 1000 * traits.seed
    x, y, z = p.T
    ax = np.abs(x)
    ear = ear_weight(p)
    paint = np.empty((len(p), 4), np.float32)
    paint[:, :3] = traits.skin
    paint[:, 3] = 0.055
    mottle, grain = fractal(p, 22.0, 3, seed + 1), fractal(p, 2.2, 3, seed + 2)
    paint[:, :3] *= 1 + np.outer(mottle, [0.035, 0.06, 0.07]) + np.outer(grain, [0.035, 0.045, 0.05])

    def tint(weight: np.ndarray, colour: tuple[float, float, float]) -> None:
        """Multiply by a colour where the weight is 1."""
        paint[:, :3] *= 1 + np.multiply.outer(weight, np.asarray(colour, np.float32) - 1)

    def cover(weight: np.ndarray, colour: tuple[float, float, float], gloss: float | None = None) -> None:
        """Paint over."""
        weight = weight[:, None]
        paint[:, :3] += weight * (np.asarray(colour, np.float32) - paint[:, :3])
        if gloss is not None:
            paint[:, 3] += weight[:, 0] * (gloss - paint[:, 3])

    flush = bump(p, (42, -8, 72), (19, 17, 30)) + 0.9 * bump(p, (0, -9, 116), (13, 11, 14)) + 0.7 * ear
    flush += 0.4 * bump(p, (0, -76, 98), (16, 10, 20))
    tint(np.clip(traits.redness * flush * (1 + 0.5 * mottle), 0, 1.2), (1.0, 0.80, 0.79))
    tint(bump(p, (32, 15, 80), (15, 6, 18)), (0.90, 0.85, 0.88))  # under the eyes
    tint(bump(p, (34, 37, 84), (14, 6, 20)), (0.93, 0.86, 0.85))  # upper lid
    tint(bump(p, (0, 78, 92), (45, 24, 40)), (1.03, 1.03, 1.02))
    tint(smoothstep((-70 - y - 0.35 * z) / 30), (0.96, 0.94, 0.93))  # neck
    paint[:, 3] += 0.05 * (bump(p, (0, -6, 114), (12, 22, 20)) + 0.6 * bump(p, (0, 75, 92), (40, 24, 40)))
    if traits.freckles > 0:
        where = bump(p, (26, 0, 88), (30, 20, 40)) + 0.5 * bump(p, (0, 70, 90), (50, 30, 40))
        tint(np.clip(1.3 * traits.freckles * where * spots(p, 3.2, 0.5, seed + 3), 0, 0.8), (0.74, 0.60, 0.50))
    tint(np.clip(spots(p, 16.0, 0.06, seed + 4) * 6 - 4.2, 0, 1), (0.50, 0.38, 0.32))  # a few moles
    if traits.stubble > 0:
        beard = smoothstep((-12 - y - 0.35 * (ax - 20) + 5 * mottle) / 24) * smoothstep((z - 4) / 30)
        beard *= smoothstep((y + 118) / 30) * (1 - 0.8 * bump(p, (32, -20, 85), (17, 13, 34)))
        dots = 0.55 + 0.9 * np.clip(fractal(p, 1.0, 1, seed + 5), -0.3, 1)
        tint(np.clip(traits.stubble * beard * dots, 0, 0.7), (0.66, 0.66, 0.67))
    _mouth(p, traits, cover, tint, seed)
    _eyes(p, traits, cover)
    brow = brow_weight(p)
    slanted = np.stack([x + 0.7 * np.abs(y), y, z], axis=1).astype(np.float32)
    strokes = fractal(slanted, (1.3, 3.5, 6.0), 2, seed + 8)
    shade = tuple(np.asarray(traits.hair) * 0.7 + 0.25 * np.asarray(traits.skin))
    cover(np.clip(smoothstep(brow / 0.55) * traits.brows * (0.62 + 0.5 * strokes), 0, 0.85), shade, 0.03)
    # Under the hair; its edge is ragged.
    edge = above_hairline(p) + 5 * fractal(p, 9.0, 2, seed + 9)
    under = smoothstep((edge + 1) / 12) * (1 - ear) * (ax < 82)
    cover(0.86 * under, tuple(np.asarray(traits.hair) * 0.75 + 0.06 * np.asarray(traits.skin)), 0.02)
    return np.clip(paint, 0, 1)


def _mouth(p: np.ndarray, traits: Traits, cover: Callable, tint: Callable, seed: int) -> None:
    x, y, z = p.T
    ax = np.abs(x)
    under, over = lip_borders(x)
    edge = np.minimum(over - y, y - under) + 0.25 * fractal(p, 2.5, 2, seed + 6)
    red = smoothstep((edge + 0.35) / 0.9) * smoothstep((25.0 - ax) / 1.5) * smoothstep((z - 78) / 4)
    cover(0.92 * red, traits.lips, 0.13)
    wrinkles = fractal(p, (1.1, 9.0, 9.0), 2, seed + 7)
    tint(np.clip(red * (0.35 * wrinkles), -0.3, 0.5), (0.80, 0.72, 0.72))
    tint(bump(p, (24, -44.3, 92), (3.5, 3.5, 9)), (0.70, 0.58, 0.56))  # corner
    line = np.abs(y - lip_line.py_func(x))
    tint(np.exp(-((line / 1.1) ** 2)) * red, (0.62, 0.42, 0.42))
    inside = smoothstep((1.22 - ((x / 26) ** 2 + ((y + 44) / 14) ** 2 + ((z - 78) / 21) ** 2)) / 0.1)
    inside = np.maximum(inside, (line < 0.9) * smoothstep((100.0 - z) / 3)) * (ax < 27) * (z > 50)
    cover(inside, (0.42, 0.16, 0.15), 0.05)
    cover(inside * smoothstep((-44.5 - y) / 3) * (ax < 19), (0.66, 0.33, 0.33), 0.08)  # tongue
    nostril = ((ax - 6.8) / 3.6) ** 2 + ((y + 20.5) / 6.0) ** 2 + ((z - 105) / 6.0) ** 2
    cover(smoothstep((1.25 - nostril) / 0.5) * smoothstep((-13.0 - y) / 2), (0.16, 0.07, 0.06), 0.0)
    canal = ((ax - 72) / 7) ** 2 + ((y - 9) / 5) ** 2 + ((z + 10) / 5) ** 2
    tint(smoothstep((1.2 - canal) / 0.9), (0.45, 0.32, 0.30))


def _eyes(p: np.ndarray, traits: Traits, cover: Callable) -> None:
    x, y, z = np.abs(p[:, 0]), p[:, 1], p[:, 2]
    lower, upper = lid_margins.py_func(x)
    front = (z > EYE_Z) & (x > 14) & (x < 50) & (np.abs(y - EYE_Y) < 16)
    radius = np.sqrt((x - EYE_X) ** 2 + (y - EYE_Y) ** 2 + (z - EYE_Z) ** 2)
    over, under = np.abs(y - upper), np.abs(y - lower)
    at_lid = front * (upper > lower - 0.6) * (radius < 18)
    rim = front * (radius < SOCKET_RADIUS + 1.3) * (y < upper + 1) * (y > lower - 1)
    cover(rim, (0.76, 0.48, 0.44), 0.12)  # the moist margin
    cover(front * (radius < SOCKET_RADIUS + 0.35) * ((y > upper + 0.7) | (y < lower - 0.7)), (0.25, 0.12, 0.11), 0.0)
    cover(0.8 * at_lid * np.exp(-((over / 0.75) ** 2)), (0.13, 0.08, 0.07))
    cover(0.38 * at_lid * np.exp(-((under / 0.6) ** 2)) * smoothstep((x - 22) / 8), (0.22, 0.13, 0.11))
    behind = (z <= EYE_Z + 1) & (radius < SOCKET_RADIUS + 1)
    cover(behind.astype(np.float32), (0.25, 0.12, 0.11), 0.0)


def paint_eyeball(points: Float32[np.ndarray, "n 3"], traits: Traits) -> Float32[np.ndarray, "n 4"]:
    """The same on an eyeball, at points relative to its centre with the gaze along +z."""
    seed = 1000 * traits.seed + 50
    x, y, z = points.T
    off = np.hypot(x, y)  # distance from the optical axis
    turn = np.arctan2(y, x)
    paint = np.empty((len(points), 4), np.float32)
    paint[:, :3] = (0.87, 0.84, 0.82)
    paint[:, 3] = 0.35
    far = smoothstep((off - 7.0) / 5.0)
    veins = np.clip(fractal(points, (2.5, 1.2, 2.5), 3, seed), 0, 1)
    paint[:, :3] *= 1 + np.outer(far * (0.35 + 0.9 * veins), [-0.06, -0.24, -0.24])
    ring = np.stack([6 * np.cos(turn), 6 * np.sin(turn), 0.35 * off], axis=1).astype(np.float32)
    fibres = fractal(ring, 0.75, 2, seed + 1)
    iris = np.asarray(traits.iris) * (1.15 + 0.55 * fibres)[:, None]
    iris *= (0.72 + 0.5 * smoothstep((off - 2.2) / 2.5))[:, None]
    iris += np.outer(np.exp(-(((off - 2.7) / 0.8) ** 2)), [0.10, 0.06, 0.01])
    iris *= (1 - 0.75 * smoothstep((off - 4.7) / 1.1))[:, None]  # limbus
    inside = (smoothstep((_IRIS_RADIUS + 0.35 - off) / 0.7) * (z > 0))[:, None]
    paint[:, :3] += inside * (iris - paint[:, :3])
    pupil = (smoothstep((_PUPIL_RADIUS + 0.25 - off) / 0.5) * (z > 0))[:, None]
    paint[:, :3] += pupil * (np.float32(0.015) - paint[:, :3])
    paint[:, 3] += np.where(off < EYE_RADIUS * 0.5, 0.25, 0.0)
    return np.clip(paint, 0, 1)
