"""A shirt: collar and shoulders below the border of the neck, as frames of real people show them.

It is rendered, but not part of the head model, and follows the root joint alone: neither the neck joint nor a
caricature moves it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int

from carigs.capture.images import to_linear
from carigs.head import HeadModel, HeadParameters, neutral
from carigs.head.joint_transforms import rotation_matrices
from carigs.head.neck_border import NeckBorder, neck_border
from carigs.toy.look.ambient_visibility import ambient_visibility
from carigs.toy.look.lighting import KEY_COLOUR, StudioLight
from carigs.toy.shape.noise import gradient_noise
from carigs.toy.shape.template import grid_faces

COLUMNS = 256
"""Vertices around the neck."""
COLLAR = np.array([(-20, -20), (-8, -7), (1, 1.5), (6, 5), (8, 6), (10, 5), (14, -9)]) * 1e-3
"""Profile of the collar from its inside to its outside in metres: distance from the neck, height above its border. The
inside reaches into the neck, so that no camera looks below the head."""
SPACING = 1.5e-3
"""Metres between the rings of the collar: the pattern of the cloth needs them."""
HALF_WIDTH, HALF_DEPTH = 0.205, 0.105
"""Half axes of the torso in metres."""
DROP, SHOULDER_RINGS = 0.06, 64
"""Metres by which the shoulders fall from the collar to their sides, and their rings."""
LENGTH, TORSO_RINGS = 0.25, 48
"""Metres of the torso below the shoulders, and its rings."""
STRIPE, UNEVEN = 0.011, 7.0
"""Width of a pair of stripes in metres, and scale of the unevenness of the cloth in millimetres."""
COLOURS = np.array([[0.23, 0.33, 0.47], [0.80, 0.76, 0.68]])
"""sRGB colours of the stripes."""


class Shirt(NamedTuple):
    """The shirt on the neutral head of its subject."""

    vertices: Float32[np.ndarray, "c 3"]
    """Metres."""
    faces: Int[np.ndarray, "g 3"]
    colours: Float32[np.ndarray, "c 3"]
    """sRGB in [0, 1]."""
    visibility: Float32[np.ndarray, " c"]
    """Ambient visibility below the head, in [0, 1]."""


def make_shirt(model: HeadModel, person: HeadParameters, seed: int) -> Shirt:
    """Make the shirt of a subject.

    Args:
        model: The head model, whose lowest border is that of the neck.
        person: Identity of the subject.
        seed: Of the unevenness of the cloth.

    Returns:
        The shirt.
    """
    head = neutral(model, person)
    border = neck_border(model, head)
    assert border is not None
    rings = _rings(border, head)
    closed = np.pad(np.arange(rings[..., 0].size).reshape(-1, COLUMNS), ((0, 0), (0, 1)), "wrap")
    faces, vertices = grid_faces(closed).astype(np.int32), rings.reshape(-1, 3).astype(np.float32)
    together = np.concatenate([model.faces, faces + np.int32(len(head))])
    visibility = ambient_visibility(np.concatenate([head, vertices]), together)[len(head) :]
    return Shirt(vertices, faces, _cloth(rings, seed), visibility)


def pose_shirt(shirt: Shirt, model: HeadModel, parameters: HeadParameters) -> Float[np.ndarray, "c 3"]:
    """Move the shirt with the root joint of the natural head.

    Args:
        shirt: The shirt.
        model: The head model.
        parameters: Identity and pose of the head.

    Returns:
        World positions in metres.
    """
    root = model.joint_regressor[0].astype(np.float64) @ neutral(model, parameters)
    return (shirt.vertices - root) @ rotation_matrices(parameters.rotation).T + root + parameters.translation


def shade_shirt(
    shirt: Shirt, normals: Float[np.ndarray, "c 3"], lit: Float[np.ndarray, " c"], light: StudioLight
) -> Float32[np.ndarray, "c 3"]:
    """Shade the shirt, which is matt.

    Args:
        shirt: The shirt.
        normals: Unit normals in world axes.
        lit: Share of the key light that reaches each vertex.
        light: The light of the studio.

    Returns:
        Linear colours.
    """
    key = (normals @ light.key_direction).clip(0)[:, None] * lit[:, None] * KEY_COLOUR
    return (to_linear(shirt.colours) * (light.ambient(normals) * shirt.visibility[:, None] + key)).astype(np.float32)


def _rings(border: NeckBorder, head: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "r c 3"]:
    """Rings of vertices from the inside of the collar over the shoulders down to the end of the torso."""
    turn = np.arange(COLUMNS) * 2 * np.pi / COLUMNS
    arm = head[border.vertices] - border.centre
    order = np.argsort(np.arctan2(arm[:, 0], arm[:, 2]))
    neck = np.interp(turn, border.azimuth, np.hypot(arm[order, 0], arm[order, 2]), period=2 * np.pi)
    length = _along(COLLAR)
    at = np.linspace(0, length[-1], round(length[-1] / SPACING) + 1)
    out, up = (np.interp(at, length, COLLAR[:, k])[:, None] for k in (0, 1))
    torso = 1 / np.hypot(np.sin(turn) / HALF_WIDTH, np.cos(turn) / HALF_DEPTH)
    angle = np.linspace(0, np.pi / 2, SHOULDER_RINGS + 1)[1:, None]
    end = neck + COLLAR[-1, 0]
    below = -np.linspace(0, LENGTH, TORSO_RINGS + 1)[1:, None]
    radius = np.concatenate([neck + out, end + (torso - end) * np.sin(angle), np.tile(torso, (TORSO_RINGS, 1))])
    height = np.concatenate([up, COLLAR[-1, 1] - DROP * (1 - np.cos(angle)), COLLAR[-1, 1] - DROP + below])
    sides = np.stack([radius * np.sin(turn), np.broadcast_to(height, radius.shape), radius * np.cos(turn)], axis=-1)
    return border.centre + sides


def _cloth(rings: Float[np.ndarray, "r c 3"], seed: int) -> Float32[np.ndarray, "n 3"]:
    """Stripes along the rings, as wide on the shoulders as on the chest, and uneven."""
    side = rings[:, COLUMNS // 4]
    stripe = 0.5 + 0.5 * np.tanh(3 * np.sin(2 * np.pi * _along(side) / STRIPE))
    share = np.repeat(stripe, COLUMNS)[:, None]
    noise = gradient_noise(1e3 * rings.reshape(-1, 3).astype(np.float32), UNEVEN, 2, 1000 * seed + 90)[:, None]
    colours = ((1 - share) * COLOURS[0] + share * COLOURS[1]) * (1 + 0.25 * noise)
    return colours.clip(0, 1).astype(np.float32)


def _along(points: Float[np.ndarray, "n d"]) -> Float[np.ndarray, " n"]:
    """Length of a polyline up to each of its points."""
    return np.concatenate([[0.0], np.linalg.norm(np.diff(points, axis=0), axis=1).cumsum()])
