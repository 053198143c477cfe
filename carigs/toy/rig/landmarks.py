"""The 68 iBUG landmarks: the template vertices nearest to given positions. Lengths are in millimetres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Int
from scipy.spatial import cKDTree

from carigs.toy.rig.regions import lip_borders
from carigs.toy.shape import anatomy
from carigs.toy.shape.template import Template

Point = tuple[float, float, float]

# Left half of each group, from the outside to the midline.
_JAW = [(69, 14, 18), (67, -4, 20), (64, -22, 22), (60, -40, 26), (53, -57, 36), (43, -71, 52), (30, -81, 70),
        (15, -86, 86), (0, -88, 90)]  # fmt: skip
_BROW = [(52, 46, 66), (43, 51, 76), (33, 52, 84), (22, 50, 90), (12, 47, 94)]
_BRIDGE = [(0, 33, 93), (0, 22, 98), (0, 10, 105), (0, -6, 120)]
_NOSTRILS = [(13, -18, 99), (7, -20, 106), (0, -21, 108)]


def landmarks68(template: Template) -> Int[np.ndarray, "68"]:
    """Find the landmark vertices.

    Args:
        template: The template mesh, in millimetres.

    Returns:
        Vertex indices in iBUG's order, which begins at the subject's right ear.
    """
    eye, outer, inner = _eye(), _outer_lips(), _inner_lips()
    positions = np.array([
        *_right(_JAW[:-1]), *_JAW[::-1],
        *_right(_BROW), *_BROW[::-1],
        *_BRIDGE,
        *_right(_NOSTRILS[:-1]), *_NOSTRILS[::-1],
        *_right(eye), *(eye[i] for i in (3, 2, 1, 0, 5, 4)),
        *_right(outer[:3]), *(outer[i] for i in (3, 2, 1, 0, 4, 5, 6)), *_right([outer[5], outer[4]]),
        *_right(inner[:2]), *(inner[i] for i in (2, 1, 0, 3, 4)), *_right([inner[3]]),
    ], float)  # fmt: skip
    # The lips touch: inner lip landmarks are searched on the lip that they belong to.
    height = template.vertices[:, 1] - anatomy.lip_height(template.vertices[:, 0])
    ids = _nearest(template, template.on_head, positions)
    ids[61:64] = _nearest(template, template.on_head & (height > 0), positions[61:64])
    ids[65:68] = _nearest(template, template.on_head & (height < 0), positions[65:68])
    return ids


def _nearest(template: Template, candidates: np.ndarray, points: np.ndarray) -> np.ndarray:
    ids = np.flatnonzero(candidates)
    return ids[cKDTree(template.vertices[ids]).query(points)[1]]


def _right(points: list[Point]) -> list[Point]:
    return [(-x, y, z) for x, y, z in points]


def _eye() -> list[Point]:
    """Outer corner, upper lid towards the nose, inner corner, lower lid away from it."""
    eye_x, eye_y, eye_z = anatomy.EYE_CENTRE
    x = np.array([anatomy.CANTHUS_OUTER, eye_x + 5, eye_x - 5, anatomy.CANTHUS_INNER, eye_x - 5, eye_x + 5])
    lower, upper = anatomy.lid_margins(x)
    y = np.where([True, True, True, True, False, False], upper, lower)
    z = eye_z + np.sqrt(np.maximum(14.2**2 - (x - eye_x) ** 2 - (y - eye_y) ** 2, 25.0))
    return list(zip(x, y, z, strict=True))


def _outer_lips() -> list[Point]:
    """Corner, two points of the upper lip, its middle, two points of the lower lip, its middle."""
    x = np.array([anatomy.MOUTH_CORNER, 16, 5.5, 0, 16, 8, 0])
    lower, upper = lip_borders(x)
    y = np.concatenate([anatomy.lip_height(x[:1]), upper[1:4], lower[4:]])
    return list(zip(x, y, [92.0, 100, 106, 106, 98, 103, 105], strict=True))


def _inner_lips() -> list[Point]:
    """Corner, upper lip, its middle, lower lip, its middle."""
    x = np.array([22.5, 9, 0, 9, 0])
    y = anatomy.lip_height(x) + np.array([0, 0.8, 0.8, -0.8, -0.8])
    return list(zip(x, y, [94.0, 101, 103, 101, 103], strict=True))
