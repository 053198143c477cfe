"""Vertex regions of the template, named as in FLAME_masks, and the curves that bound them. Lengths in millimetres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Int

from carigs.mesh.smoothstep import smoothstep
from carigs.toy.shape import anatomy
from carigs.toy.shape.head_solids import head_solids
from carigs.toy.shape.signed_distance import solids_distance
from carigs.toy.shape.template import NECK_CUT, Template

# Height of the hairline by azimuth in degrees: 0 forehead, 70 sideburn, 95 over the ear, 180 nape.
_AZIMUTH = np.array([0.0, 14, 26, 38, 47, 55, 62, 68, 73, 78, 86, 100, 112, 120, 132, 150, 180])
_HAIRLINE = np.array([104.0, 105, 103, 94, 80, 62, 40, 20, 14, 30, 47, 47, 32, 0, -30, -44, -48])


def height_above_hairline(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Signed height above the hairline.

    Args:
        points: Positions on the template, in millimetres.

    Returns:
        Heights in millimetres, positive where hair grows.
    """
    x, y, z = points.T
    return y - np.interp(np.degrees(np.arctan2(np.abs(x), z + 10.0)), _AZIMUTH, _HAIRLINE)


def ear_weight(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Weight of the outer ear.

    Args:
        points: Positions on the template, in millimetres.

    Returns:
        0 on the head, rising to 1 at 7 mm from the head without its ears.
    """
    weight = np.zeros(len(points), points.dtype)
    near = (np.abs(points[:, 0]) > 60) & (np.abs(points[:, 1] - 14) < 50) & (np.abs(points[:, 2] + 14) < 45)
    weight[near] = smoothstep(solids_distance(head_solids(ear=False), points[near].astype(float)) / 7.0)
    return weight


def lip_borders(x: Float[np.ndarray, " n"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Heights of the vermilion borders; they meet at the corners of the mouth.

    Args:
        x: Lateral coordinate in millimetres; the sign does not matter.

    Returns:
        y of the border of the lower lip and of the upper lip, in millimetres.
    """
    t = np.clip(np.abs(x) / 25.0, 0.0, 1.0)
    line = anatomy.lip_height(np.minimum(np.abs(x), 25.0))
    upper = 8.6 * (1 - t**1.7) - 1.5 * np.exp(-((t / 0.13) ** 2))
    return line - 10.2 * np.sqrt(1 - t**2) * (1 - 0.35 * t), line + np.maximum(upper, 0.0)


def brow_weight(points: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, " n"]:
    """Weight of the eyebrows.

    Args:
        points: Positions on the template, in millimetres.

    Returns:
        1 along the centre line of a brow, falling to 0 at its edges.
    """
    t, distance = _brow_coordinates(points)
    half = 5.0 * np.sqrt(np.clip(1.02 - t, 0, 1)) * np.clip((t + 0.08) / 0.12, 0, 1)
    inside = 1 - distance / np.maximum(half, 1e-6)
    return np.where((t > -0.08) & (t < 1.02) & (points[:, 2] > 35), np.clip(inside, 0, 1), 0.0)


def _brow_coordinates(points: Float[np.ndarray, "n 3"]) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"]]:
    """Position along a brow, 0 at its inner end and 1 at its outer end, and height distance to its centre line."""
    t = (np.abs(points[:, 0]) - 10.0) / 44.0
    return t, np.abs(points[:, 1] - (45.5 + 22.0 * t * (1 - t) + 1.5 * t))


def vertex_regions(template: Template) -> dict[str, Int[np.ndarray, " _"]]:
    """Vertices of each named region; left is the subject's left, at positive x.

    Args:
        template: The template mesh, in millimetres.

    Returns:
        Sorted vertex indices by region name.
    """
    p = template.vertices
    x, y, z = p.T
    ax, left = np.abs(x), x > 0
    on_head = template.on_head
    ear = on_head & (solids_distance(head_solids(ear=False), p) > 0.8) & (ax > 55)
    socket = anatomy.eye_distance(p) < anatomy.SOCKET_RADIUS + 0.5
    cavity = on_head & (anatomy.mouth_cavity(p) < 1.2) & (z < 97)
    scalp = on_head & ~ear & (height_above_hairline(p) > 0)
    boundary = on_head & (y < NECK_CUT + 16.0)
    neck = on_head & ~scalp & ~ear & (y + 0.35 * np.minimum(z, 60.0) < -66) & ~boundary
    face = on_head & ~scalp & ~ear & ~neck & ~boundary & (z > 0)
    eye = on_head & (np.hypot((ax - anatomy.EYE_X) / 24, (y - anatomy.EYE_Y - 1) / 17) < 1) & (z > anatomy.EYE_Z - 20)
    lower, upper = anatomy.lid_margins(ax)
    lid = eye & ((np.maximum(y - upper, lower - y) < 7) & (ax > 17) & (ax < 48) | socket)
    under, over = lip_borders(x)
    lips = on_head & ~cavity & (y > under - 0.3) & (y < over + 0.3) & (ax < 25.5) & (z > 80)
    # With a margin so that whole triangles lie inside: a brow is narrower than the edges of the mesh are long.
    along, across = _brow_coordinates(p)
    brows = face & (along > -0.2) & (along < 1.15) & (across < 9.0) & (z > 35)
    nose = on_head & (solids_distance(head_solids(nose=False), p) > 0.8) & (ax < 22) & (z > 80)
    inner_lips = lips & (np.abs(y - anatomy.lip_height(x)) < 1.0) & (z < 103)
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
        "lip_inside": cavity | inner_lips,
        "left_eyelid": lid & left,
        "right_eyelid": lid & ~left,
        "left_ear": ear & left,
        "right_ear": ear & ~left,
        "left_eyeball": template.left_eye,
        "right_eyeball": template.right_eye,
        "brows": brows,
    }
    return {name: np.flatnonzero(mask) for name, mask in masks.items()}
