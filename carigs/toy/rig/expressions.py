"""The expression basis: what faces do, one full action per column.  Millimetres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from carigs.toy.rig.skin_weights import JAW, jaw_weight
from carigs.toy.shape.falloff import bump, left_half, rotated, sideways, smoothstep
from carigs.toy.shape.field import EYE_X, EYE_Y, EYE_Z, lid_margins, lip_line

_SIDED = (
    "eye_blink", "eye_squint", "eye_wide", "brow_down", "brow_inner_up", "brow_outer_up", "cheek_puff", "cheek_raise",
    "nose_sneer", "mouth_smile", "mouth_frown", "mouth_stretch", "upper_lip_up", "lower_lip_down",
)  # fmt: skip
_WHOLE = ("jaw_open", "jaw_forward", "jaw_left", "jaw_right", "mouth_pucker", "mouth_left", "mouth_right", "lips_press")
NAMES = tuple(f"{name}_{side}" for name in _SIDED for side in ("left", "right")) + _WHOLE

OPEN_ANGLE = 0.30  # radians of the jaw in `jaw_open`
_LID = 14.0  # mm: mean radius of the lid margins about the eye
_OVERLAP = 0.7  # mm by which closed lids pass each other: their margins are rounded


def expression_basis(points: Float[np.ndarray, "n 3"], skin: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 3 e"]:
    """Displacements of template points (millimetres), in the order of `NAMES`; `skin` is 0 on the eyeballs, else 1."""
    columns = []
    for name in NAMES:
        base, _, side = name.rpartition("_")
        if base in _SIDED:
            half = left_half(points)
            columns.append(_direction(base, points) * (half if side == "left" else 1 - half)[:, None])
        else:
            columns.append(_direction(name, points))
    return np.stack(columns, axis=-1) * skin[:, None, None]


def jaw_motion(name: str, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """How points of the jaw bone move in the four expressions that move it (millimetres)."""
    if name == "jaw_open":
        return rotated(points, JAW, 0, OPEN_ANGLE) - points
    step = {"jaw_forward": (0.0, 0.0, 5.0), "jaw_left": (5.0, 0.0, 0.0), "jaw_right": (-5.0, 0.0, 0.0)}[name]
    return np.tile(step, (len(points), 1))


def _direction(name: str, p: np.ndarray) -> np.ndarray:
    x, y, _ = p.T
    none, side = np.zeros(len(p)), sideways(p)

    def field(dx: np.ndarray | float, dy: np.ndarray | float, dz: np.ndarray | float) -> np.ndarray:
        return np.stack([dx + none, dy + none, dz + none], axis=1)

    lower_lip = smoothstep((lip_line.py_func(x) - y) / 1.0 + 0.5)
    in_mouth = smoothstep((34 - np.abs(x)) / 12)
    match name:
        case "eye_blink":
            return _close_lids(p, 1.0)
        case "eye_squint":
            return _close_lids(p, 0.28) * np.where(y < EYE_Y, 1.4, 0.5)[:, None] + field(
                0, 1.6 * bump(p, (34, 14, 78), (20, 7, 20)), 0
            )
        case "eye_wide":
            return -0.28 * _close_lids(p, 1.0)
        case "brow_down":
            return field(-1.4 * side, -4.0, 0.6) * bump(p, (24, 50, 84), (26, 14, 30))[:, None] * _above_lids(p)
        case "brow_inner_up":
            return field(0, 5.5, 0.3) * bump(p, (12, 54, 88), (16, 18, 30))[:, None] * _above_lids(p)
        case "brow_outer_up":
            return field(0, 5.0, 0) * bump(p, (42, 52, 72), (17, 16, 30))[:, None] * _above_lids(p)
        case "cheek_puff":
            return field(6.5 * side, 0.5, 5.0) * bump(p, (40, -32, 68), (17, 20, 28))[:, None]
        case "cheek_raise":
            return field(0.8 * side, 3.2, 1.4) * bump(p, (38, -2, 76), (18, 16, 26))[:, None]
        case "nose_sneer":
            return field(0.4 * side, 3.0, 0.6) * bump(p, (14, -10, 98), (10, 14, 16))[:, None]
        case "mouth_smile":
            corner = field(6.5 * side, 6.0, -5.0) * bump(p, (27, -43, 90), (17, 15, 26))[:, None]
            cheek = field(1.0 * side, 3.0, 2.0) * bump(p, (38, -8, 76), (17, 16, 26))[:, None]
            return corner + cheek
        case "mouth_frown":
            return field(0.5 * side, -7.0, -1.0) * bump(p, (25, -46, 90), (15, 14, 26))[:, None]
        case "mouth_stretch":
            return field(6.0 * side, -2.0, -4.0) * bump(p, (26, -46, 90), (16, 16, 26))[:, None]
        case "upper_lip_up":
            weight = bump(p, (10, -36, 100), (15, 12, 26)) * (1 - lower_lip)
            return field(0, 5.0, 1.0) * weight[:, None]
        case "lower_lip_down":
            weight = bump(p, (10, -52, 98), (15, 14, 26)) * lower_lip
            return field(0, -5.0, 0.6) * weight[:, None]
        case "jaw_open" | "jaw_forward" | "jaw_left" | "jaw_right":
            return jaw_motion(name, p) * jaw_weight(p)[:, None]
        case "mouth_pucker":
            weight = bump(p, (0, -44, 98), (32, 20, 30))
            roll = np.clip(y - lip_line.py_func(x), -6, 6)
            return np.stack([-0.34 * x * weight, 0.18 * roll * weight, 6.0 * weight * in_mouth], axis=1)
        case "mouth_left" | "mouth_right":
            sign = 1.0 if name == "mouth_left" else -1.0
            return field(6.0 * sign, 0.4, 0) * bump(p, (0, -44, 94), (36, 22, 34))[:, None]
        case "lips_press":
            weight = bump(p, (0, -44, 100), (28, 11, 20))
            away = np.clip(y - lip_line.py_func(x), -8, 8)
            return np.stack([none, -0.22 * away * weight * smoothstep((np.abs(away) - 1) / 2), -1.6 * weight], axis=1)
    raise ValueError(name)


def _above_lids(p: np.ndarray) -> np.ndarray:
    """Brow motion fades towards the upper lid."""
    return smoothstep((p[:, 1] - 36.0) / 10.0)[:, None]


def _close_lids(p: np.ndarray, amount: float) -> np.ndarray:
    """Both lids turn about the horizontal axis through their eye until their margins meet."""
    x = np.abs(p[:, 0])
    lower, upper = lid_margins.py_func(x)
    opening = np.maximum(upper - lower, 0.0)
    # The skin of the corners follows what is left of the opening at the corner.
    meet = lower + 0.22 * opening
    overlap = _OVERLAP * smoothstep(opening / 3.0)

    def elevation(height: np.ndarray) -> np.ndarray:
        radius = np.sqrt(np.maximum(_LID**2 - (x - EYE_X) ** 2, 36.0))
        return np.arcsin(np.clip((height - EYE_Y) / radius, -0.95, 0.95))

    here = np.arctan2(p[:, 1] - EYE_Y, np.maximum(p[:, 2] - EYE_Z, 1e-3))
    above = p[:, 1] > 0.5 * (lower + upper)
    down = np.maximum(elevation(upper) - elevation(meet - overlap), 0.0)
    up = np.maximum(elevation(meet + 0.2 * overlap) - elevation(lower), 0.0)
    up_fade = 1 - smoothstep(np.maximum(here - elevation(upper), 0.0) * _LID / 11.0)
    down_fade = 1 - smoothstep(np.maximum(elevation(lower) - here, 0.0) * _LID / 10.0)
    radial = np.sqrt((x - EYE_X) ** 2 + (p[:, 1] - EYE_Y) ** 2 + (p[:, 2] - EYE_Z) ** 2)
    near = (1 - smoothstep((radial - 16.5) / 6.0)) * (p[:, 2] > EYE_Z) * (opening > 0)
    angle = amount * near * np.where(above, down * up_fade, -up * down_fade)
    # A positive turn about +x takes +z towards -y.
    return rotated(p, np.array([0.0, EYE_Y, EYE_Z]), 0, angle) - p
