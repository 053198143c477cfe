"""Regions of a head by its geometry, for models whose files do not name them.

Lengths are in units of half the distance between the eyes, measured from the point midway between them: in these units
the proportions of adult heads differ little, whatever the unit of the mesh. The rules are those of the procedural head
(`carigs.toy.rig.regions`), with a hairline of average height. They say where hair, lips, lids, brows and ears are
likely to be, which is enough for masks: where hair is in truth is seen in the frames.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.mesh.triangle_mesh import boundary_vertices

HAIRLINE_AXIS = -2.5
"""z of the vertical axis around which the azimuth of the hairline is measured."""
AZIMUTHS = (0.0, 14, 26, 38, 47, 55, 62, 68, 73, 78, 86, 100, 112, 120, 132, 150, 180)
"""Degrees: 0 forehead, 70 in front of the ear, 95 above the ear, 180 nape."""
HAIRLINE = (2.1, 2.1, 2.05, 1.9, 1.6, 1.1, 0.4, -0.25, -0.45, 0.05, 0.6, 0.6, 0.15, -0.9, -1.8, -2.25, -2.4)
"""Height of the hairline at these azimuths."""
EAR = np.array([-0.5, -2.7])
"""y and z of the middle of an ear."""
EAR_HALF_SIZE = np.array([1.4, 1.1])
EAR_PROTRUSION = 0.08
"""An ear stands out from the side of the head by more than this, 2.5 mm."""
LID_DISTANCE, SOCKET_DISTANCE = 1.4, 1.1
"""Largest distance of a lid, and of what else surrounds the eyeball, from its centre, in radii of the eyeball."""
BORDER_RINGS = 3
"""Edges between the border of the neck and the last vertices of the region `boundary`."""


@dataclass(frozen=True)
class FacialPoints:
    """Where eyes and mouth are on a head that looks to +z, with +y up and its left side at +x."""

    left_eyeball: Int[np.ndarray, " _"]
    """Vertices."""
    right_eyeball: Int[np.ndarray, " _"]
    """Vertices."""
    left_corner: Float[np.ndarray, "3"]
    """Left corner of the mouth."""
    right_corner: Float[np.ndarray, "3"]
    between_lips: Float[np.ndarray, "3"]
    """Where the lips meet, in the middle of the mouth."""


def geometric_regions(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    points: FacialPoints,
    skin: Bool[np.ndarray, " v"],
) -> dict[str, Int[np.ndarray, " _"]]:
    """Find the regions of a neutral head.

    Args:
        vertices: Vertices in any unit.
        faces: Triangles.
        points: Eyes and mouth.
        skin: The vertices to divide: not those of eyeballs, teeth and tongue.

    Returns:
        Vertices by FLAME_masks' names, and `brows`, `lip_inside`, `left_eyelid` and `right_eyelid` besides; empty if
        the eyes are not at the places that `FacialPoints` says.
    """
    balls = {"left": points.left_eyeball, "right": points.right_eyeball}
    centres = {side: (vertices[ids].min(axis=0) + vertices[ids].max(axis=0)) / 2 for side, ids in balls.items()}
    unit = (centres["left"] - centres["right"])[0] / 2
    if not unit > 0.1 * float(np.ptp(vertices[:, 0])) / 2:
        return {}
    origin = (centres["left"] + centres["right"]) / 2
    p = (vertices - origin).astype(np.float64) / unit
    x, y, z = np.abs(p[:, 0]), p[:, 1], p[:, 2]
    is_left = p[:, 0] > 0
    masks = {f"{side}_ear": skin & _ear(p * [sign, 1, 1], skin) for side, sign in (("left", 1), ("right", -1))}
    ears = masks["left_ear"] | masks["right_ear"]
    azimuth = np.degrees(np.arctan2(x, z - HAIRLINE_AXIS))
    scalp = skin & ~ears & (y > np.interp(azimuth, AZIMUTHS, HAIRLINE))
    border = _border(faces, skin & (y < -3))
    below_chin = y + 0.35 * np.minimum(z, -0.3) < -3.95
    face = skin & ~scalp & ~ears & ~below_chin & ~border & (z > -2.2)
    eye = skin & (np.hypot((x - 1) / 0.76, (y - 0.03) / 0.54) < 1) & (z > -0.63)
    along_brow = (x - 0.31) / 1.38
    brow_height = 0.55 + 0.69 * along_brow * (1 - along_brow) + 0.05 * along_brow
    masks |= {
        "scalp": scalp,
        "face": face,
        "neck": skin & ~scalp & ~ears & below_chin & ~border,
        "boundary": border,
        "forehead": face & (y > 0.77) & (z > -1.2) & ~eye,
        "eye_region": eye,
        "left_eye_region": eye & is_left,
        "right_eye_region": eye & ~is_left,
        "brows": face & (along_brow > -0.2) & (along_brow < 1.15) & (np.abs(y - brow_height) < 0.28) & (z > -1.1),
        "nose": skin
        & (x < np.interp(y, (-1.7, -1.15, 0.25), (0.6, 0.68, 0.22)))
        & (np.abs(y + 0.725) < 0.975)
        & (z > 0.45),
    }
    for side, ids in balls.items():
        radius = float(np.ptp(vertices[ids], axis=0).max()) / 2
        distance = np.linalg.norm(vertices - centres[side], axis=1) / radius
        lid = (distance < SOCKET_DISTANCE) | (eye & (distance < LID_DISTANCE))
        masks[f"{side}_eyelid"] = skin & lid & (is_left if side == "left" else ~is_left)
    corners = (np.array([points.left_corner, points.right_corner]) - origin) / unit
    masks |= _mouth(p, skin, corners, (points.between_lips - origin) / unit)
    return {name: np.flatnonzero(mask) for name, mask in masks.items()} | {
        f"{side}_eyeball": np.asarray(ids) for side, ids in balls.items()
    }


def _mouth(
    p: Float[np.ndarray, "v 3"], skin: Bool[np.ndarray, " v"], corners: Float[np.ndarray, "2 3"], middle: np.ndarray
) -> dict[str, Bool[np.ndarray, " v"]]:
    """The red of the lips, and what lies behind the line where they meet."""
    half = max((corners[0, 0] - corners[1, 0]) / 2, 1e-6)
    across = np.abs(p[:, 0] - middle[0]) / half
    t = np.clip(across, 0, 1)
    line = middle + (corners.mean(axis=0) - middle) * t[:, None] ** 2
    height, depth = (p[:, 1] - line[:, 1]) / half, (line[:, 2] - p[:, 2]) / half
    in_cavity = (depth > 0.6) & (np.abs(height) < 1.2)
    inside = skin & (across < 1.15) & (depth > 0.1) & (depth < 2.2) & ((np.abs(height) < 0.22) | in_cavity)
    upper, lower = 0.34 * (1 - t**1.7), 0.41 * np.sqrt(1 - t**2) * (1 - 0.35 * t)
    on_lips = (across < 1.03) & (height < upper + 0.025) & (height > -lower - 0.025) & (depth < 0.35)
    return {"lips": skin & on_lips & ~inside, "lip_inside": inside}


def _ear(p: Float[np.ndarray, "v 3"], skin: Bool[np.ndarray, " v"]) -> Bool[np.ndarray, " v"]:
    """What stands out from the side of the head at positive x.

    The side without the ear is a quadratic x = q(y, z), fitted by least squares that are iteratively reweighted:
    vertices above the last fit have little weight in the next one.
    """
    offset = (p[:, 1:] - EAR) / EAR_HALF_SIZE
    side = np.flatnonzero(skin & (p[:, 0] > 1.4) & (np.abs(offset) < 1.4).all(axis=1))
    ear = np.zeros(len(p), bool)
    if len(side) < 20:
        return ear
    y, z = offset[side].T
    terms = np.column_stack([np.ones(len(side)), y, z, y * y, y * z, z * z])
    weights, above = np.ones(len(side)), np.zeros(len(side))
    for _ in range(30):
        root = np.sqrt(weights)
        above = p[side, 0] - terms @ np.linalg.lstsq(terms * root[:, None], p[side, 0] * root, rcond=None)[0]
        weights = 1 / (1 + (np.maximum(above, 0) / 0.03) ** 2)
    ear[side] = (above > EAR_PROTRUSION) & (np.abs(offset[side]) < 1).all(axis=1)
    return ear


def _border(faces: Int[np.ndarray, "f 3"], low: Bool[np.ndarray, " v"]) -> Bool[np.ndarray, " v"]:
    """The low vertices within a few edges of a border of the mesh."""
    border = low & boundary_vertices(faces, len(low))
    for _ in range(BORDER_RINGS):
        border[faces[border[faces].any(axis=1)]] = True
        border &= low
    return border
