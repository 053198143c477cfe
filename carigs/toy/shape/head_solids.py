"""The solids that a neutral head is made of.

Coordinates are in millimetres: x to the subject's left, y up, z forward. The origin lies between the ear canals.
Only the left half is listed; the signed distance function mirrors it.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Shaped

from carigs.toy.shape.anatomy import EYE_X, EYE_Y, EYE_Z
from carigs.toy.shape.solids import chain, ellipsoid, round_cone

_HEAD = [
    # skull
    ellipsoid((0, 57, -7), (75, 83, 94), 0.0),
    ellipsoid((0, 62, 30), (59, 56, 66), 20.0),  # forehead
    ellipsoid((0, 12, -48), (60, 52, 49), 25.0),  # occiput
    *chain([(0, 43, 85, 9), (16, 45, 84.5, 8), (34, 48, 75, 8), (50, 40, 60, 6)], 18.0),  # brow ridge
    # jaw
    ellipsoid((0, -6, 40), (58, 72, 52), 24.0),
    ellipsoid((0, -64, 42), (36, 26, 44), 20.0),
    *chain([(54, 0, 8, 13), (43.5, -42, 18, 13), (32, -66, 54, 12.5), (15, -77, 80, 12.5), (0, -78, 84, 13)], 22.0),
    ellipsoid((43, -24, 30), (17, 37, 28), 18.0),  # masseter
    ellipsoid((0, -75, 86), (19, 13, 14.5), 14.0),  # chin
    # neck
    round_cone((0, -55, -20, 46), (0, -190, -34, 50), 24.0),
    round_cone((0, -100, 22, 15), (0, -190, 10, 17), 24.0),  # larynx
    round_cone((54, -20, -20, 10), (20, -190, 20, 10), 20.0),  # sternocleidomastoid
    round_cone((22, -60, -60, 21), (46, -236, -50, 38), 24.0),  # trapezius
    # cheeks
    ellipsoid((41, 2, 60), (21, 15, 20), 18.0),  # cheek bone
    round_cone((49, 4, 50, 9), (60, 8, 10, 9), 22.0),  # zygomatic arch
    ellipsoid((36, -24, 62), (21, 30, 23), 20.0),
    ellipsoid((0, -40, 73), (32, 28, 29.8), 14.0),  # muzzle
    # orbits
    ellipsoid((31, 34.5, 95), (18, 8, 14), 10.0, carve=True),
    ellipsoid((17.0, 27, 90), (5, 8, 8), 10.0, carve=True),  # beside the nasal bridge
    ellipsoid((EYE_X, EYE_Y, EYE_Z), (15.2, 15.2, 15.2), 6.0),  # the lids over the eyeball
    *chain([(20, 33.0, 85.5, 1.0), (26, 37.2, 86, 1.5), (34, 38.4, 85, 1.5), (42, 36, 80.2, 1.3)], 3.0, carve=True),
]
_NOSE = [
    *chain([(0, 37, 85, 7.5), (0, 14, 97, 6.5), (0, -4, 107, 9.5)], 12.0),
    round_cone((7, 24, 80, 6), (8, -5, 96, 8.5), 12.0),
    ellipsoid((0, -8.5, 109), (9.5, 9, 11), 5.0),  # tip
    ellipsoid((12.3, -13.5, 99.5), (5.6, 6.6, 9.5), 3.5),  # ala
    round_cone((0, -15, 112, 4.0), (0, -19, 105, 4.2), 6.0),  # columella
    ellipsoid((6.8, -20.5, 105), (3.1, 6.0, 5.5), 2.0, carve=True),  # nostril
]
_MOUTH = [
    round_cone((0, -24, 107.5, 1.5), (0, -33, 108, 2.0), 6.0, carve=True),  # philtrum
    *chain([(0, -39.2, 102, 4.4), (6, -38.3, 102, 4.7), (15, -40.4, 98.2, 4.3), (25.5, -43.8, 89.5, 2.4)], 4, parts=6),
    *chain([(0, -49.2, 100.5, 5.8), (9, -49, 99.5, 5.7), (18, -47, 95.2, 4.4), (25.5, -44.6, 89, 2.6)], 4, parts=6),
    ellipsoid((28.5, -45, 95.5), (2, 3, 3.5), 6.0, carve=True),  # corner
]


def head_solids(*, nose: bool = True, ear: bool = True) -> Shaped[np.ndarray, " n"]:
    """All solids of the head in the order in which they are blended, without the openings of eyes and mouth.

    Args:
        nose: Whether the nose is included.
        ear: Whether the ears are included.

    Returns:
        One row per solid (see `carigs.toy.shape.solids`).
    """
    return np.stack(_HEAD + _NOSE * nose + _MOUTH + _ear() * ear)


def _ear() -> list[np.ndarray]:
    origin = np.array([67.0, 14.0, -6.0])
    up, back = np.array([0.06, 0.97, -0.20]), np.array([0.45, 0.0, -0.89])
    up /= np.linalg.norm(up)
    back -= up * (up @ back)
    back /= np.linalg.norm(back)
    out = np.cross(back, up)
    axes = np.stack([back, up, out])

    def at(a: float, b: float, c: float) -> tuple[float, ...]:
        return tuple(origin + a * back + b * up + c * out)

    def curve(points: list[tuple[float, float, float, float]], blend: float) -> list[np.ndarray]:
        return chain([(*at(a, b, c), r) for a, b, c, r in points], blend)

    helix = [(10, -2, 0, 1.6), (5, 6, 3, 2.4), (4, 17, 4.5, 2.8), (9, 28, 5, 3.0), (19, 32, 5, 3.0), (28, 27, 5, 3.0),
             (32, 15, 5, 2.8), (31, 2, 5, 2.6), (27, -10, 4, 2.5), (20, -20, 3, 2.6), (12, -25, 2, 3.0)]  # fmt: skip
    return [
        ellipsoid(at(16, 4, 0), (16.5, 29, 4.2), 6.0, axes=axes),
        ellipsoid(at(6, 0, -6), (10, 24, 8), 8.0, axes=axes),
        ellipsoid(at(9.5, -23, 1), (8, 8.5, 3.8), 5.0, axes=axes),  # lobe
        *curve(helix, 3.0),
        *curve([(20, -14, 2, 2.6), (24, -2, 3, 2.8), (22, 10, 3, 2.8), (15, 21, 3, 2.2)], 4.0),  # antihelix
        *curve([(22, 9, 3, 2.4), (12, 14, 2, 1.8)], 4.0),
        ellipsoid(at(13, -2, 3.5), (8, 10.5, 6), 3.0, axes=axes, carve=True),  # concha
        ellipsoid(at(2, -4, 3), (4, 5.5, 3.5), 4.0, axes=axes),  # tragus
        ellipsoid(at(13, -15, 3), (5, 3.2, 3), 4.0, axes=axes),  # antitragus
    ]
