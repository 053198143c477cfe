"""Named regions of the template, by FLAME_masks' names, and the curves that bound them.  Millimetres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from carigs.toy.shape import sculpture
from carigs.toy.shape.falloff import smoothstep
from carigs.toy.shape.field import EYE_X, EYE_Y, EYE_Z, SOCKET_RADIUS, distances, lid_margins, lip_line
from carigs.toy.shape.template import NECK_CUT, Template

# Height of the hairline by azimuth in degrees: 0 forehead, 70 sideburn, 95 over the ear, 180 nape.
_AZIMUTH = np.array([0.0, 14, 26, 38, 47, 55, 62, 68, 73, 78, 86, 100, 112, 120, 132, 150, 180])
_HAIRLINE = np.array([104.0, 105, 103, 94, 80, 62, 40, 20, 14, 30, 47, 47, 32, 0, -30, -44, -48])


def above_hairline(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """Signed height over the hairline: positive where hair grows."""
    x, y, z = points.T
    return y - np.interp(np.degrees(np.arctan2(np.abs(x), z + 10.0)), _AZIMUTH, _HAIRLINE)


def ear_weight(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """0 on the head, rising to 1 on the outer ear."""
    weight = np.zeros(len(points), points.dtype)
    near = (np.abs(points[:, 0]) > 60) & (np.abs(points[:, 1] - 14) < 50) & (np.abs(points[:, 2] + 14) < 45)
    weight[near] = smoothstep(distances(sculpture.solids(without="ear"), points[near].astype(float)) / 7.0)
    return weight


def lip_borders(x: Float[np.ndarray, "n"]) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Heights of the lower and the upper border of the red of the lips over |x|; they meet at the corners."""
    t = np.clip(np.abs(x) / 25.0, 0.0, 1.0)
    line = lip_line.py_func(np.minimum(np.abs(x), 25.0))
    upper = 8.6 * (1 - t**1.7) - 1.5 * np.exp(-((t / 0.13) ** 2))
    return line - 10.2 * np.sqrt(1 - t**2) * (1 - 0.35 * t), line + np.maximum(upper, 0.0)


def brow_weight(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n"]:
    """1 along the middle of the brows, 0 outside of them."""
    t, off = _along_brow(points)
    half = 5.0 * np.sqrt(np.clip(1.02 - t, 0, 1)) * np.clip((t + 0.08) / 0.12, 0, 1)
    inside = 1 - off / np.maximum(half, 1e-6)
    return np.where((t > -0.08) & (t < 1.02) & (points[:, 2] > 35), np.clip(inside, 0, 1), 0.0)


def _along_brow(points: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Where along the brows, 0 at the inner end and 1 at the outer, and how far above or below their middle."""
    t = (np.abs(points[:, 0]) - 10.0) / 44.0
    return t, np.abs(points[:, 1] - (45.5 + 22.0 * t * (1 - t) + 1.5 * t))


def regions(shape: Template) -> dict[str, Int[np.ndarray, "_"]]:
    """Vertex ids by region name; left is the subject's, at positive x."""
    p = shape.vertices
    x, y, z = p.T
    ax, left = np.abs(x), x > 0
    skin = shape.skin
    ear = skin & (distances(sculpture.solids(without="ear"), p) > 0.8) & (ax > 55)
    socket = np.sqrt((ax - EYE_X) ** 2 + (y - EYE_Y) ** 2 + (z - EYE_Z) ** 2) < SOCKET_RADIUS + 0.5
    bag = skin & ((ax / 26) ** 2 + ((y + 44) / 14) ** 2 + ((z - 78) / 21) ** 2 < 1.2) & (z < 97)
    scalp = skin & ~ear & (above_hairline(p) > 0)
    low = y + 0.35 * np.minimum(z, 60.0)
    boundary = skin & (y < NECK_CUT + 16.0)
    neck = skin & ~scalp & ~ear & (low < -66) & ~boundary
    face = skin & ~scalp & ~ear & ~neck & ~boundary & (z > 0)
    eye = skin & (np.hypot((ax - EYE_X) / 24, (y - EYE_Y - 1) / 17) < 1) & (z > EYE_Z - 20)
    lower, upper = lid_margins.py_func(ax)
    lid = eye & ((np.maximum(y - upper, lower - y) < 7) & (ax > 17) & (ax < 48) | socket)
    under, over = lip_borders(x)
    lips = skin & ~bag & (y > under - 0.3) & (y < over + 0.3) & (ax < 25.5) & (z > 80)
    # Brows are narrower than the mesh is coarse: a margin, so that whole triangles lie inside.
    along, off = _along_brow(p)
    brows = face & (along > -0.2) & (along < 1.15) & (off < 9.0) & (z > 35)
    nose = skin & (distances(sculpture.solids(without="nose"), p) > 0.8) & (ax < 22) & (z > 80)
    inner_lips = lips & (np.abs(y - lip_line.py_func(x)) < 1.0) & (z < 103)
    masks = {
        "face": face,
        "neck": neck,
        "scalp": scalp,
        "boundary": boundary,
        "forehead": face & (y > 52) & (z > 30) & ~eye,
        "eye_region": eye,
        "left_eye_region": eye & left,
        "right_eye_region": eye & ~left,
        "nose": nose,
        "lips": lips,
        "lip_inside": bag | inner_lips,
        "left_eyelid": lid & left,
        "right_eyelid": lid & ~left,
        "left_ear": ear & left,
        "right_ear": ear & ~left,
        "left_eyeball": shape.left_eye,
        "right_eyeball": shape.right_eye,
        "brows": brows,
    }
    return {name: np.flatnonzero(mask) for name, mask in masks.items()}
