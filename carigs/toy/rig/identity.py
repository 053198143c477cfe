"""Identity basis: one direction of variation per column, one standard deviation long. Lengths are in millimetres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from carigs.mesh.smoothstep import smoothstep
from carigs.toy.rig.regions import ear_weight
from carigs.toy.shape.anatomy import EYE_CENTRE, EYE_X, EYE_Y, EYE_Z, lip_height
from carigs.toy.shape.falloff import displacement_field, gaussian, gaussian_displacement, rotated, smooth_sign

NAMES = (
    "width", "skull_height", "skull_depth", "forehead", "face_length", "jaw_width", "chin_height", "chin_depth",
    "cheek_bones", "cheek_fat", "nose_length", "nose_width", "nose_depth", "nose_hump", "nose_tip", "eye_distance",
    "eye_size", "eye_depth", "brow_ridge", "lip_thickness", "lip_depth", "mouth_width", "ear_size", "ear_flare",
    "neck_width", "nose_bend", "jaw_shift",
)  # fmt: skip
"""The columns of the basis, in order."""
ASYMMETRIC = ("nose_bend", "jaw_shift")

# Displacements with Gaussian falloff: displacement at the centre, centre and radii.
_GAUSSIANS = {
    "forehead": ((0, 0, 3.0), (0, 100, 70), (70, 35, 60)),
    "jaw_width": ((4.0, 0, 0), (50, -48, 22), (24, 30, 40)),
    "chin_height": ((0, -3.0, 0), (0, -82, 80), (36, 26, 40)),
    "chin_depth": ((0, 0, 3.5), (0, -78, 88), (30, 20, 34)),
    "cheek_bones": ((2.4, 0.4, 1.6), (48, 4, 58), (20, 17, 28)),
    "cheek_fat": ((3.0, 0, 2.0), (44, -28, 58), (22, 26, 34)),
    "nose_length": ((0, -2.6, 0), (0, -12, 106), (22, 18, 28)),
    "nose_width": ((2.0, 0, 0), (13, -12, 100), (11, 14, 18)),
    "nose_depth": ((0, 0, 3.0), (0, -6, 110), (15, 18, 24)),
    "nose_hump": ((0, 0, 2.0), (0, 14, 98), (9, 13, 18)),
    "nose_tip": ((0, 2.4, 0), (0, -9, 113), (13, 11, 16)),
    "eye_distance": ((1.6, 0, 0), (EYE_X, EYE_Y, 75), (24, 26, 34)),
    "eye_depth": ((0, 0, -1.8), (EYE_X, EYE_Y, 72), (24, 20, 34)),
    "lip_depth": ((0, 0, 2.0), (0, -44, 102), (28, 17, 30)),
    "mouth_width": ((2.4, 0, 0), (24, -44, 92), (16, 15, 26)),
    "nose_bend": ((1.2, 0, 0), (0, -8, 108), (16, 16, 26)),
    "jaw_shift": ((1.5, 0, 0), (0, -66, 80), (45, 34, 60)),
}


def identity_basis(points: Float[np.ndarray, "n 3"], eyeball: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3 k"]:
    """Evaluate the identity basis on the template.

    Around the eyes every column is a similarity, the same for eyeball and lids: eyeballs stay round and lids stay on
    them.

    Args:
        points: Positions on the template, in millimetres.
        eyeball: +1 on the left, -1 on the right eyeball and 0 elsewhere.

    Returns:
        Displacements in millimetres per standard deviation, in the order of `NAMES`.
    """
    return np.stack([_rigid_around_eyes(points, eyeball, name) for name in NAMES], axis=-1)


def _rigid_around_eyes(points: np.ndarray, eyeball: np.ndarray, name: str) -> np.ndarray:
    displacement = _displacement(name, points)
    for side in (1.0, -1.0):
        centre = EYE_CENTRE * [side, 1, 1]
        weight = 1 - smoothstep((np.linalg.norm(points - centre, axis=1) - 16.0) / 16.0)
        weight = np.where(eyeball == side, 1.0, np.where(eyeball == 0, weight, 0.0))
        # Translation and scale by central differences with a step of 1 mm.
        moved = _displacement(name, centre + np.concatenate([np.zeros((1, 3)), np.eye(3), -np.eye(3)]))
        growth = np.mean([(moved[1 + i, i] - moved[4 + i, i]) / 2.0 for i in range(3)])
        similarity = moved[0] + growth * (points - centre)
        displacement = displacement + weight[:, None] * (similarity - displacement)
    return displacement


def _displacement(name: str, p: np.ndarray) -> np.ndarray:
    """Displacement per standard deviation, before the correction around the eyes."""
    if name in _GAUSSIANS:
        return gaussian_displacement(p, *_GAUSSIANS[name], mirrored=name not in ASYMMETRIC)
    x, y, z = p.T
    side = smooth_sign(p)
    match name:
        case "width":
            return displacement_field(p, 0.03 * x, 0, 0)
        case "skull_height":
            return displacement_field(p, 0, 0.06 * np.maximum(y - 40, 0) ** 2 / (np.maximum(y - 40, 0) + 20), 0)
        case "skull_depth":
            return displacement_field(p, 0, 0, -5.0 * smoothstep(-(z - 20) / 110))
        case "face_length":
            return displacement_field(p, 0, -4.0 * smoothstep((35 - y) / 120), 0)
        case "eye_size":
            weight = gaussian(p, (EYE_X, EYE_Y, EYE_Z), (30, 26, 30))
            return 0.05 * weight[:, None] * (p - displacement_field(p, side * EYE_X, EYE_Y, EYE_Z))
        case "brow_ridge":
            up, forward = gaussian(p, (26, 48, 84), (34, 10, 30)), gaussian(p, (24, 48, 84), (36, 10, 30))
            return displacement_field(p, 0, -0.6 * up, 2.2 * forward)
        case "lip_thickness":
            weight = gaussian(p, (0, -44, 100), (30, 13, 22))
            away = np.clip(y - lip_height(x), -8.0, 8.0)
            return displacement_field(p, 0, 0.2 * weight * away, 0.5 * weight)
        case "ear_size":
            return 0.08 * ear_weight(p)[:, None] * (p - displacement_field(p, 66 * side, 14, -2))
        case "ear_flare":
            folded = np.stack([np.abs(x), y, z], axis=1)
            moved = rotated(folded, np.array([68.0, 0.0, -4.0]), 1, 0.14 * ear_weight(p)) - folded
            return moved * displacement_field(p, side, 1, 1)
        case "neck_width":
            weight = smoothstep((-70 - y - 0.35 * z) / 60)[:, None]
            return 0.06 * weight * displacement_field(p, x, 0, z + 20)
    raise ValueError(name)
