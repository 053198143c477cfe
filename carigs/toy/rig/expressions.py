"""Expression basis: one facial action per column, named after ARKit's blendshapes. Lengths are in millimetres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from carigs.mesh.smoothstep import smoothstep
from carigs.toy.rig.skin_weights import JAW, jaw_weight
from carigs.toy.shape.anatomy import EYE_CENTRE, EYE_X, EYE_Y, EYE_Z, eye_distance, lid_margins, lip_height
from carigs.toy.shape.falloff import displacement_field, gaussian, gaussian_displacement, rotated, smooth_sign

_ONE_SIDED = (
    "eye_blink", "eye_squint", "eye_wide", "brow_down", "brow_inner_up", "brow_outer_up", "cheek_puff", "cheek_raise",
    "nose_sneer", "mouth_smile", "mouth_frown", "mouth_stretch", "upper_lip_up", "lower_lip_down",
)  # fmt: skip
_JAW_STEP = {"jaw_forward": (0.0, 0.0, 5.0), "jaw_left": (5.0, 0.0, 0.0), "jaw_right": (-5.0, 0.0, 0.0)}
JAW_NAMES = ("jaw_open", *_JAW_STEP)
"""The expressions that move the jaw bone."""
NAMES = (
    *(f"{name}_{side}" for name in _ONE_SIDED for side in ("left", "right")),
    *JAW_NAMES, "mouth_pucker", "mouth_left", "mouth_right", "lips_press",
)  # fmt: skip
"""The columns of the basis, in order."""

# Displacements with Gaussian falloff: displacement at the centre, centre and radii.
_GAUSSIANS = {
    "eye_squint": ((0, 1.6, 0), (34, 14, 78), (20, 7, 20)),
    "brow_down": ((-1.4, -4.0, 0.6), (24, 50, 84), (26, 14, 30)),
    "brow_inner_up": ((0, 5.5, 0.3), (12, 54, 88), (16, 18, 30)),
    "brow_outer_up": ((0, 5.0, 0), (42, 52, 72), (17, 16, 30)),
    "cheek_puff": ((6.5, 0.5, 5.0), (40, -32, 68), (17, 20, 28)),
    "cheek_raise": ((0.8, 3.2, 1.4), (38, -2, 76), (18, 16, 26)),
    "nose_sneer": ((0.4, 3.0, 0.6), (14, -10, 98), (10, 14, 16)),
    "mouth_smile": ((6.5, 6.0, -5.0), (27, -43, 90), (17, 15, 26)),
    "mouth_frown": ((0.5, -7.0, -1.0), (25, -46, 90), (15, 14, 26)),
    "mouth_stretch": ((6.0, -2.0, -4.0), (26, -46, 90), (16, 16, 26)),
    "mouth_left": ((6.0, 0.4, 0), (0, -44, 94), (36, 22, 34)),
    "mouth_right": ((-6.0, 0.4, 0), (0, -44, 94), (36, 22, 34)),
}
_OPEN_ANGLE = 0.30  # radians of the jaw in `jaw_open`
_LID_RADIUS = 14.0  # mean distance of the lid margins from the centre of the eyeball
_OVERLAP = 0.7  # closed lids overlap by this much, because their margins are rounded


def expression_basis(points: Float[np.ndarray, "n 3"], on_head: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n 3 e"]:
    """Evaluate the expression basis on the template.

    Args:
        points: Positions on the template, in millimetres.
        on_head: 1 on the head surface, 0 on the eyeballs, which do not move.

    Returns:
        Displacements in millimetres at full activation, in the order of `NAMES`.
    """
    left = 0.5 + 0.5 * smooth_sign(points, 6.0)[:, None]
    columns = [_displacement(name, points) * side for name in _ONE_SIDED for side in (left, 1 - left)]
    columns += [_displacement(name, points) for name in NAMES[len(columns) :]]
    return np.stack(columns, axis=-1) * on_head[:, None, None]


def jaw_motion(name: str, points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3"]:
    """Motion of points fixed to the jaw bone in an expression that moves it.

    Args:
        name: One of `JAW_NAMES`.
        points: Positions on the template, in millimetres.

    Returns:
        Displacements in millimetres at full activation.
    """
    if name == "jaw_open":
        return rotated(points, JAW, 0, _OPEN_ANGLE) - points
    return np.tile(_JAW_STEP[name], (len(points), 1))


def _displacement(name: str, p: np.ndarray) -> np.ndarray:
    """Displacement by one action, on both sides of the face."""
    if name in JAW_NAMES:
        return jaw_motion(name, p) * jaw_weight(p)[:, None]
    x, y, _ = p.T
    if name in _GAUSSIANS:
        moved = gaussian_displacement(p, *_GAUSSIANS[name], mirrored=name not in ("mouth_left", "mouth_right"))
    above_line = y - lip_height(x)
    lower_lip = smoothstep((lip_height(x) - y) / 1.0 + 0.5)
    match name:
        case "eye_blink":
            return _lid_closure(p, 1.0)
        case "eye_squint":
            return _lid_closure(p, 0.28) * np.where(y < EYE_Y, 1.4, 0.5)[:, None] + moved
        case "eye_wide":
            return -0.28 * _lid_closure(p, 1.0)
        case "brow_down" | "brow_inner_up" | "brow_outer_up":
            return moved * smoothstep((p[:, 1] - 36.0) / 10.0)[:, None]  # fades towards the upper lid
        case "mouth_smile":
            return moved + gaussian_displacement(p, (1.0, 3.0, 2.0), (38, -8, 76), (17, 16, 26))
        case "upper_lip_up":
            weight = gaussian(p, (10, -36, 100), (15, 12, 26)) * (1 - lower_lip)
            return displacement_field(p, 0, 5.0, 1.0) * weight[:, None]
        case "lower_lip_down":
            weight = gaussian(p, (10, -52, 98), (15, 14, 26)) * lower_lip
            return displacement_field(p, 0, -5.0, 0.6) * weight[:, None]
        case "mouth_pucker":
            weight = gaussian(p, (0, -44, 98), (32, 20, 30))
            up, forward = 0.18 * np.clip(above_line, -6, 6) * weight, 6.0 * weight * smoothstep((34 - np.abs(x)) / 12)
            return np.stack([-0.34 * x * weight, up, forward], axis=1)
        case "lips_press":
            weight = gaussian(p, (0, -44, 100), (28, 11, 20))
            away = np.clip(above_line, -8, 8)
            up = -0.22 * away * weight * smoothstep((np.abs(away) - 1) / 2)
            return np.stack([np.zeros(len(p)), up, -1.6 * weight], axis=1)
        case _:
            return moved


def _lid_closure(p: np.ndarray, amount: float) -> np.ndarray:
    """Displacement that rotates both lids about the lateral axis through their eye until the margins meet."""
    x = np.abs(p[:, 0])
    lower, upper = lid_margins(x)
    opening = np.maximum(upper - lower, 0.0)
    meet = lower + 0.22 * opening  # the height at which the margins meet
    overlap = _OVERLAP * smoothstep(opening / 3.0)

    def elevation(height: np.ndarray) -> np.ndarray:
        radius = np.sqrt(np.maximum(_LID_RADIUS**2 - (x - EYE_X) ** 2, 36.0))
        return np.arcsin(np.clip((height - EYE_Y) / radius, -0.95, 0.95))

    own = np.arctan2(p[:, 1] - EYE_Y, np.maximum(p[:, 2] - EYE_Z, 1e-3))
    is_upper = p[:, 1] > 0.5 * (lower + upper)
    down = np.maximum(elevation(upper) - elevation(meet - overlap), 0.0)
    up = np.maximum(elevation(meet + 0.2 * overlap) - elevation(lower), 0.0)
    upper_fade = 1 - smoothstep(np.maximum(own - elevation(upper), 0.0) * _LID_RADIUS / 11.0)
    lower_fade = 1 - smoothstep(np.maximum(elevation(lower) - own, 0.0) * _LID_RADIUS / 10.0)
    near = (1 - smoothstep((eye_distance(p) - 16.5) / 6.0)) * (p[:, 2] > EYE_Z) * (opening > 0)
    # A positive rotation about +x turns +z towards -y.
    angle = amount * near * np.where(is_upper, down * upper_fade, -up * lower_fade)
    return rotated(p, EYE_CENTRE * [0, 1, 1], 0, angle) - p
