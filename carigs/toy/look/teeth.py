"""Teeth: rendered, but not part of the head model, as in real captures. Modelled in millimetres."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from carigs.capture.images import to_linear
from carigs.head import HeadModel, HeadParameters, neutral
from carigs.toy.look.lighting import KEY_COLOUR, StudioLight
from carigs.toy.rig import expressions
from carigs.toy.shape.template import grid_faces

_ROWS, _COLUMNS = 5, 6  # vertices of one tooth
# Widths of half a jaw's teeth from the midline outwards (incisors, canine, premolars, molars), millimetres.
_WIDTHS = np.array([8.4, 6.8, 7.6, 6.8, 6.6, 9.0, 9.0])


def build_teeth() -> tuple[Float[np.ndarray, "t 3"], Int[np.ndarray, "g 3"], Float[np.ndarray, "t 3"], int]:
    """Build the teeth on the template.

    Returns:
        Vertices in millimetres (upper teeth first), faces, sRGB colours of the vertices, number of upper vertices.
    """
    upper, faces, upper_colours = _arch(gum=-35.5, edge=-45.3, front=96.3, half=21.0)
    lower, lower_faces, lower_colours = _arch(gum=-53.0, edge=-45.0, front=94.5, half=19.5)
    # The lower arch is upside down: its faces are reversed.
    faces = np.concatenate([faces, lower_faces[:, ::-1] + len(upper)])
    return np.concatenate([upper, lower]), faces, np.concatenate([upper_colours, lower_colours]), len(upper)


def attach_teeth(model: HeadModel, teeth: Float[np.ndarray, "t 3"], upper: int) -> HeadModel:
    """Append the teeth to the vertices of a head model: upper teeth move with the head, lower teeth with the jaw.

    Args:
        model: The head model.
        teeth: Vertices of the teeth on the template, in metres.
        upper: Number of vertices of the upper teeth.

    Returns:
        The head model with the teeth.
    """
    n = len(teeth)
    weights = np.eye(5, dtype=np.float32)[np.where(np.arange(n) < upper, 1, 2)]
    directions = np.zeros((n, 3, model.shapedirs.shape[2]), np.float32)
    for name in expressions.JAW_NAMES:
        column = model.num_identity + expressions.NAMES.index(name)
        directions[upper:, :, column] = 1e-3 * expressions.jaw_motion(name, 1e3 * teeth[upper:].astype(float))
    return replace(
        model,
        v_template=np.concatenate([model.v_template, teeth]),
        shapedirs=np.concatenate([model.shapedirs, directions]),
        posedirs=np.concatenate([model.posedirs, np.zeros((n, *model.posedirs.shape[1:]), np.float32)]),
        joint_regressor=np.concatenate([model.joint_regressor, np.zeros((5, n), np.float32)], axis=1),
        weights=np.concatenate([model.weights, weights]),
    )


def teeth_displacement(
    model: HeadModel,
    teeth: Float[np.ndarray, "t 3"],
    parameters: HeadParameters,
    displacement: Float[np.ndarray, "v 3"],
) -> Float[np.ndarray, "t 3"]:
    """Displacement of the teeth by identity and caricature: the affine map that fits the inside of the lips best.

    Args:
        model: The head model without teeth.
        teeth: Vertices of the teeth on the template, in metres.
        parameters: Identity and static offset are used.
        displacement: Displacement of the neutral head by the caricature, in metres.

    Returns:
        Displacements from the template, in metres.
    """
    ids = model.regions["lip_inside"]
    before = np.concatenate([model.v_template[ids], np.ones((len(ids), 1))], axis=1)
    affine = np.linalg.lstsq(before, neutral(model, parameters)[ids] + displacement[ids], rcond=None)[0]
    return np.concatenate([teeth, np.ones((len(teeth), 1))], axis=1) @ affine - teeth


def shade_teeth(
    colours: Float[np.ndarray, "t 3"], normals: Float[np.ndarray, "t 3"], light: StudioLight
) -> Float[np.ndarray, "t 3"]:
    """Diffuse shading of the teeth, dimmed because the lips cast a shadow on them.

    Args:
        colours: sRGB colours of the vertices, in [0, 1].
        normals: Unit normals in world axes.
        light: The light of the studio.

    Returns:
        Linear colours.
    """
    toward = np.clip(normals @ light.key_direction, 0, 1)[:, None]
    return to_linear(colours) * (0.75 * light.ambient(normals) + 0.55 * toward * KEY_COLOUR)


def _arch(gum: float, edge: float, front: float, half: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Vertices, faces and colours of one jaw: heights of gum and biting edge, foremost z, half width (millimetres)."""
    edges = np.concatenate([[0], np.cumsum(_WIDTHS)])
    across = np.concatenate([-edges[::-1], edges[1:]]) / edges[-1]
    u = (across[:-1, None] + np.diff(across)[:, None] * np.linspace(0, 1, _COLUMNS)).reshape(-1)
    s = np.tile(np.linspace(-1, 1, _COLUMNS), len(across) - 1)  # across one tooth
    v = np.linspace(0, 1, _ROWS)[:, None]  # gum to edge
    theta = u * 1.35
    x = half * np.sin(theta) / np.sin(1.35)
    z = front - 27.0 * (1 - np.cos(theta)) / (1 - np.cos(1.35))
    outward = np.stack([np.sin(theta), 0 * theta, np.cos(theta)], axis=1)
    bulge = 0.9 * np.sqrt(np.clip(1 - s**2, 0, 1))
    height = gum + (edge - gum) * (v - 0.06 * v * (s**4)[None])
    flat = np.stack([np.broadcast_to(x, height.shape), height, np.broadcast_to(z, height.shape)], axis=-1)
    profile = np.sin(np.pi * (0.15 + 0.6 * v))
    vertices = flat + (bulge[None] + 0.8 * profile)[..., None] * outward
    gap = np.clip((np.abs(s) - 0.75) / 0.25, 0, 1)
    colour = np.array([0.90, 0.87, 0.79]) * (1 - 0.55 * gap)[None, :, None] * (0.80 + 0.2 * v)[..., None]
    colour = colour + np.clip(1 - v / 0.22, 0, 1)[..., None] * (np.array([0.66, 0.36, 0.36]) - colour)  # gums
    shade = (1 - 0.65 * np.abs(u) ** 1.5)[None, :, None]  # darker towards the back of the mouth
    faces = grid_faces(np.arange(height.size).reshape(height.shape))
    return vertices.reshape(-1, 3), faces, (colour * shade).reshape(-1, 3)
