"""The identity basis: what makes people differ, one standard deviation per column.  Millimetres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from carigs.toy.rig.regions import ear_weight
from carigs.toy.shape.falloff import bump, rotated, sideways, smoothstep
from carigs.toy.shape.field import EYE_X, EYE_Y, EYE_Z, lip_line

NAMES = (
    "width", "skull_height", "skull_depth", "forehead", "face_length", "jaw_width", "chin_height", "chin_depth",
    "cheek_bones", "cheek_fat", "nose_length", "nose_width", "nose_depth", "nose_hump", "nose_tip", "eye_distance",
    "eye_size", "eye_depth", "brow_ridge", "lip_thickness", "lip_depth", "mouth_width", "ear_size", "ear_flare",
    "neck_width", "nose_bend", "jaw_shift",
)  # fmt: skip
ASYMMETRIC = ("nose_bend", "jaw_shift")


def identity_basis(points: Float[np.ndarray, "n 3"], eyeball: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n 3 k"]:
    """Displacements of template points (millimetres), in the order of `NAMES`.

    `eyeball` is +1 on the left, -1 on the right eyeball and 0 elsewhere.  Around the eyes every column is a similarity,
    the same for ball and lids: eyeballs stay round and the lids stay on them.
    """
    columns = [_around_eyes(points, eyeball, name) for name in NAMES]
    return np.stack(columns, axis=-1)


def _around_eyes(points: np.ndarray, eyeball: np.ndarray, name: str) -> np.ndarray:
    free = _direction(name, points)
    for side in (1.0, -1.0):
        centre = np.array([side * EYE_X, EYE_Y, EYE_Z])
        weight = 1 - smoothstep((np.linalg.norm(points - centre, axis=1) - 16.0) / 16.0)
        weight = np.where(eyeball == side, 1.0, np.where(eyeball == 0, weight, 0.0))
        step = 1.0
        probe = centre + step * np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)])
        moved = _direction(name, probe)
        growth = np.mean([(moved[1 + i, i] - moved[4 + i, i]) / (2 * step) for i in range(3)])
        similar = moved[0] + growth * (points - centre)
        free = free + weight[:, None] * (similar - free)
    return free


def _direction(name: str, p: np.ndarray) -> np.ndarray:
    x, y, z = p.T
    none, side = np.zeros(len(p)), sideways(p)

    def field(dx: np.ndarray | float, dy: np.ndarray | float, dz: np.ndarray | float) -> np.ndarray:
        return np.stack([dx + none, dy + none, dz + none], axis=1)

    match name:
        case "width":
            return field(0.03 * x, 0, 0)
        case "skull_height":
            return field(0, 0.06 * np.maximum(y - 40, 0) ** 2 / (np.maximum(y - 40, 0) + 20), 0)
        case "skull_depth":
            return field(0, 0, -5.0 * smoothstep(-(z - 20) / 110))
        case "forehead":
            return field(0, 0, 3.0 * bump(p, (0, 100, 70), (70, 35, 60)))
        case "face_length":
            return field(0, -4.0 * smoothstep((35 - y) / 120), 0)
        case "jaw_width":
            return field(4.0 * side * bump(p, (50, -48, 22), (24, 30, 40)), 0, 0)
        case "chin_height":
            return field(0, -3.0 * bump(p, (0, -82, 80), (36, 26, 40)), 0)
        case "chin_depth":
            return field(0, 0, 3.5 * bump(p, (0, -78, 88), (30, 20, 34)))
        case "cheek_bones":
            return bump(p, (48, 4, 58), (20, 17, 28))[:, None] * field(2.4 * side, 0.4, 1.6)
        case "cheek_fat":
            return bump(p, (44, -28, 58), (22, 26, 34))[:, None] * field(3.0 * side, 0, 2.0)
        case "nose_length":
            return field(0, -2.6 * bump(p, (0, -12, 106), (22, 18, 28)), 0)
        case "nose_width":
            return field(2.0 * side * bump(p, (13, -12, 100), (11, 14, 18)), 0, 0)
        case "nose_depth":
            return field(0, 0, 3.0 * bump(p, (0, -6, 110), (15, 18, 24)))
        case "nose_hump":
            return field(0, 0, 2.0 * bump(p, (0, 14, 98), (9, 13, 18)))
        case "nose_tip":
            return field(0, 2.4 * bump(p, (0, -9, 113), (13, 11, 16)), 0)
        case "eye_distance":
            return field(1.6 * side * bump(p, (EYE_X, EYE_Y, 75), (24, 26, 34)), 0, 0)
        case "eye_size":
            weight = bump(p, (EYE_X, EYE_Y, EYE_Z), (30, 26, 30))
            return 0.05 * weight[:, None] * (p - np.stack([side * EYE_X, EYE_Y + none, EYE_Z + none], axis=1))
        case "eye_depth":
            return field(0, 0, -1.8 * bump(p, (EYE_X, EYE_Y, 72), (24, 20, 34)))
        case "brow_ridge":
            return field(0, -0.6 * bump(p, (26, 48, 84), (34, 10, 30)), 2.2 * bump(p, (24, 48, 84), (36, 10, 30)))
        case "lip_thickness":
            weight = bump(p, (0, -44, 100), (30, 13, 22))
            apart = np.sign(y - lip_line.py_func(x)) * np.minimum(np.abs(y - lip_line.py_func(x)), 8.0)
            return field(0, 0.2 * weight * apart, 0.5 * weight)
        case "lip_depth":
            return field(0, 0, 2.0 * bump(p, (0, -44, 102), (28, 17, 30)))
        case "mouth_width":
            return field(2.4 * side * bump(p, (24, -44, 92), (16, 15, 26)), 0, 0)
        case "ear_size":
            return 0.08 * ear_weight(p)[:, None] * (p - np.stack([66 * side, 14 + none, -2 + none], axis=1))
        case "ear_flare":
            pivot = np.array([68.0, 0.0, -4.0])
            folded = np.stack([np.abs(x), y, z], axis=1)
            moved = rotated(folded, pivot, 1, 0.14 * ear_weight(p)) - folded
            return moved * field(side, 1, 1)
        case "neck_width":
            weight = smoothstep((-70 - y - 0.35 * z) / 60)[:, None]
            return 0.06 * weight * np.stack([x, none, z + 20], axis=1)
        case "nose_bend":
            return field(1.2 * bump(p, (0, -8, 108), (16, 16, 26)), 0, 0)
        case "jaw_shift":
            return field(1.5 * bump(p, (0, -66, 80), (45, 34, 60)), 0, 0)
    raise ValueError(name)
