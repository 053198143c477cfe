"""Long hair: a fringe that ends above the eyes, and hair that falls over ears and nape. Lengths in millimetres."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from carigs.mesh.smoothstep import smoothstep
from carigs.toy.look.strands import RootedStrands, bind, height_and_normal, sample_roots, tangential, unit_vectors
from carigs.toy.rig.attributes import Attributes
from carigs.toy.rig.regions import ear_weight, height_above_hairline
from carigs.toy.shape.falloff import displacement_field
from carigs.toy.shape.head_solids import head_solids
from carigs.toy.shape.noise import gradient_noise
from carigs.toy.shape.template import Template

KNOTS = 20
"""Points of a strand."""
STEP, STEPS = 7.0, 44
"""Length and number of the steps in which a strand grows before it is cut."""
FRINGE_END, FALL_END = 40.0, -78.0
"""Mean heights at which the fringe and the other hair are cut: the brows are at 46, the chin is at -60."""
FRINGE_AZIMUTH = (34.0, 52.0)
"""Degrees from the front, seen from the crown, between which the fringe passes into the other hair."""
LOOSE = 45.0
"""Length after which a strand hangs down, whichever way it is combed at its root."""


def grow_long_hair(template: Template, attributes: Attributes, rng: np.random.Generator, count: int) -> RootedStrands:
    """Grow the hair of the scalp.

    Strands are combed from the crown outwards, lie on the head and on each other in layers, and hang down where the
    head recedes.

    Args:
        template: The template mesh.
        attributes: Seed and colour of the hair.
        rng: Draws roots and strands.
        count: Number of strands.

    Returns:
        The strands.
    """
    density = smoothstep((height_above_hairline(template.vertices) + 6) / 12)
    roots = sample_roots(template, density * (ear_weight(template.vertices) < 0.05) * template.on_head, count, rng)
    roots = roots.where(height_above_hairline(roots.point) > rng.uniform(-3, 4, count))
    n = len(roots.point)
    noise = [gradient_noise(roots.point.astype(np.float32), 14.0, 2, 1000 * attributes.seed + 60 + k) for k in range(4)]
    clump, uneven = np.stack(noise[:3], axis=1), noise[3]
    azimuth = np.degrees(np.abs(np.arctan2(roots.point[:, 0], roots.point[:, 2] + 25.0)))
    fall = smoothstep((azimuth - FRINGE_AZIMUTH[0]) / (FRINGE_AZIMUTH[1] - FRINGE_AZIMUTH[0]))
    end = FRINGE_END + fall * (FALL_END - FRINGE_END) + 9 * uneven + rng.normal(0, 4, n)
    points = _cut(_grown(roots.point, clump, rng), end)
    along = np.linspace(0, 1, KNOTS)
    tone = (1 + 0.16 * rng.standard_normal(n) + 0.5 * clump[:, 0]).clip(0.55, 1.7)[:, None]
    colour = np.clip(np.asarray(attributes.hair) * tone * [1.03, 1.0, 0.96], 0, 1)
    return bind(template, roots, points, rng.uniform(0.8, 1.2, n), colour, 0.62 + 0.38 * along**0.7)


def _grown(
    root: Float[np.ndarray, "n 3"], clump: Float[np.ndarray, "n 3"], rng: np.random.Generator
) -> Float[np.ndarray, "n s 3"]:
    """Strands of full length."""
    solids, n = head_solids(), len(root)
    stray = 0.45 * clump + 0.10 * rng.standard_normal((n, 3))
    layer = rng.uniform(1.0, 9.0, n)  # height above the head, which gives the hair its volume
    points = np.empty((n, STEPS + 1, 3))
    points[:, 0] = root
    _, normal = height_and_normal(solids, root)
    lift = np.radians(rng.uniform(15, 35, n))[:, None]
    direction = unit_vectors(np.cos(lift) * _combed(root, normal, stray) + np.sin(lift) * normal)
    down = displacement_field(root, 0, -1.0, 0) + 0.15 * stray
    for k in range(1, STEPS + 1):
        point = points[:, k - 1] + STEP * direction
        height, normal = height_and_normal(solids, point)
        point += normal * np.clip(np.minimum(layer, 0.6 * STEP * k) - height, 0, STEP)[:, None]
        points[:, k] = point
        loose = smoothstep(STEP * k / LOOSE)
        wanted = unit_vectors((1 - loose) * _combed(point, normal, stray) + loose * down)
        near = smoothstep((layer + 6 - height) / 6)[:, None]  # does not grow into the head
        wanted = wanted - normal * near * np.minimum((wanted * normal).sum(axis=1, keepdims=True), 0)
        direction = unit_vectors(0.5 * direction + 0.5 * unit_vectors(wanted))
    return points


def _combed(points: np.ndarray, normals: np.ndarray, stray: np.ndarray) -> np.ndarray:
    """Unit tangents away from the crown, which is at the back of the head."""
    angle = np.arctan2(points[:, 0], points[:, 2] + 25.0)
    outwards = displacement_field(points, np.sin(angle), -0.25, np.cos(angle))
    return tangential(outwards + stray, normals)


def _cut(points: Float[np.ndarray, "n s 3"], end: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n k 3"]:
    """Strands up to the first point below the height `end`, as `KNOTS` points at equal distances."""
    below = points[:, :, 1] < end[:, None]
    below[:, :2] = False  # two steps at least
    last = np.where(below.any(axis=1), below.argmax(axis=1), points.shape[1] - 1)
    place = last[:, None] * np.linspace(0, 1, KNOTS)
    index = np.minimum(place.astype(int), points.shape[1] - 2)
    share, rows = (place - index)[:, :, None], np.arange(len(points))[:, None]
    return (1 - share) * points[rows, index] + share * points[rows, index + 1]
