"""Teeth: drawn, but no part of the head model, as in real captures.  Millimetres."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from carigs.capture.images import to_linear
from carigs.head import HeadModel, HeadParameters, neutral
from carigs.head.model import N_SHAPE
from carigs.toy.look.lighting import KEY_COLOUR, Light
from carigs.toy.rig import expressions

ROWS, COLUMNS, TEETH = 5, 6, 14  # texture of one tooth; teeth in a jaw


def jaws() -> tuple[Float[np.ndarray, "t 3"], Int[np.ndarray, "g 3"], Float[np.ndarray, "t 3"], int]:
    """Vertices, faces and colours (sRGB) of the upper, then the lower teeth, and the number of upper vertices."""
    upper, faces, colours = _arch(gum=-35.5, edge=-45.3, front=96.3, half=21.0)
    lower, lower_faces, lower_colours = _arch(gum=-53.0, edge=-45.0, front=94.5, half=19.5)
    vertices = np.concatenate([upper, lower])
    # The lower arch runs the other way up: its faces turn.
    faces = np.concatenate([faces, lower_faces[:, ::-1] + len(upper)])
    return vertices, faces, np.concatenate([colours, lower_colours]), len(upper)


def with_teeth(model: HeadModel, teeth: Float[np.ndarray, "t 3"], upper: int) -> HeadModel:
    """The head model with the teeth (metres) behind its vertices: the upper ones on the skull, the lower on the jaw."""
    n = len(teeth)
    weights = np.zeros((n, 5), np.float32)
    weights[:upper, 1] = 1.0
    weights[upper:, 2] = 1.0
    directions = np.zeros((n, 3, model.shapedirs.shape[2]), np.float32)
    for name in ("jaw_open", "jaw_forward", "jaw_left", "jaw_right"):
        column = N_SHAPE + expressions.NAMES.index(name)
        directions[upper:, :, column] = 1e-3 * expressions.jaw_motion(name, 1e3 * teeth[upper:].astype(float))
    return replace(
        model,
        v_template=np.concatenate([model.v_template, teeth]),
        shapedirs=np.concatenate([model.shapedirs, directions]),
        posedirs=np.concatenate([model.posedirs, np.zeros((n, 3, 36), np.float32)]),
        joint_regressor=np.concatenate([model.joint_regressor, np.zeros((5, n), np.float32)], axis=1),
        weights=np.concatenate([model.weights, weights]),
    )


def follow(
    model: HeadModel,
    teeth: Float[np.ndarray, "t 3"],
    parameters: HeadParameters,
    displacement: Float[np.ndarray, "v 3"],
) -> Float[np.ndarray, "t 3"]:
    """Displacement of the teeth: the affine map that fits best what identity and caricature do to the inner mouth."""
    ids = model.regions["lip_inside"]
    before = np.concatenate([model.v_template[ids], np.ones((len(ids), 1))], axis=1)
    affine = np.linalg.lstsq(before, neutral(model, parameters)[ids] + displacement[ids], rcond=None)[0]
    return np.concatenate([teeth, np.ones((len(teeth), 1))], axis=1) @ affine - teeth


def lit(colours: Float[np.ndarray, "t 3"], normals: Float[np.ndarray, "t 3"], light: Light) -> Float[np.ndarray, "t 3"]:
    """Linear colours as seen: teeth stand in the shade of the lips."""
    toward = np.clip(normals @ light.key, 0, 1)[:, None]
    return to_linear(colours) * (0.75 * light.ambient(normals) + 0.55 * toward * KEY_COLOUR)


def _arch(gum: float, edge: float, front: float, half: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    # Widths of the teeth from the middle outwards (incisors, canine, premolars, molar), mirrored.
    widths = np.array([8.4, 6.8, 7.6, 6.8, 6.6, 9.0, 9.0])
    edges = np.concatenate([[0], np.cumsum(widths)])
    across = np.concatenate([-edges[::-1], edges[1:]]) / edges[-1]
    u = np.concatenate([a + (b - a) * np.linspace(0, 1, COLUMNS) for a, b in itertools.pairwise(across)])
    s = np.tile(np.linspace(-1, 1, COLUMNS), len(across) - 1)  # across one tooth
    v = np.linspace(0, 1, ROWS)  # gum to edge
    theta = u * 1.35
    x = half * np.sin(theta) / np.sin(1.35)
    z = front - 27.0 * (1 - np.cos(theta)) / (1 - np.cos(1.35))
    outward = np.stack([np.sin(theta), 0 * theta, np.cos(theta)], axis=1)
    bulge = 0.9 * np.sqrt(np.clip(1 - s**2, 0, 1))
    height = gum + (edge - gum) * (v[:, None] - 0.06 * v[:, None] * (s**4)[None])
    flat = np.stack([np.broadcast_to(x, height.shape), height, np.broadcast_to(z, height.shape)], axis=-1)
    profile = np.sin(np.pi * (0.15 + 0.6 * v))[:, None]
    vertices = flat + (bulge[None] + 0.8 * profile)[..., None] * outward
    n = len(u)
    ids = np.arange(ROWS * n).reshape(ROWS, n)
    a, b, c, d = ids[:-1, :-1], ids[:-1, 1:], ids[1:, 1:], ids[1:, :-1]
    faces = np.concatenate([np.stack([a, d, b], -1).reshape(-1, 3), np.stack([b, d, c], -1).reshape(-1, 3)])
    gap = np.clip((np.abs(s) - 0.75) / 0.25, 0, 1)
    colour = np.array([0.90, 0.87, 0.79]) * (1 - 0.55 * gap)[None, :, None] * (0.80 + 0.2 * v)[:, None, None]
    gums = np.clip(1 - v / 0.22, 0, 1)[:, None, None]
    colour = colour + gums * (np.array([0.66, 0.36, 0.36]) - colour)
    shade = (1 - 0.65 * np.abs(u) ** 1.5)[None, :, None]  # the back of the mouth is dark
    return vertices.reshape(-1, 3), faces, (colour * shade).reshape(-1, 3)
