"""Hair strands on scalp, brows and lids, grown on the template and bound to its triangles. Lengths in millimetres."""

from __future__ import annotations

import numpy as np

from carigs.mesh.smoothstep import smoothstep
from carigs.toy.look.long_hair import grow_long_hair
from carigs.toy.look.strands import (
    RootedStrands,
    bind,
    height_and_normal,
    sample_roots,
    tangential,
    unit_vectors,
    with_knots,
)
from carigs.toy.rig.attributes import Attributes
from carigs.toy.rig.regions import brow_weight, ear_weight, height_above_hairline
from carigs.toy.shape.anatomy import lid_margins
from carigs.toy.shape.falloff import displacement_field
from carigs.toy.shape.head_solids import head_solids
from carigs.toy.shape.noise import gradient_noise
from carigs.toy.shape.template import Template

_KNOTS = 8  # points of a strand
_ALONG = np.linspace(0, 1, _KNOTS)  # position of the knots on it


def grow_hair(template: Template, attributes: Attributes, count: int, *, long: bool = False) -> RootedStrands:
    """Grow all hair of a person.

    Args:
        template: The template mesh, in millimetres.
        attributes: Seed, colours and hair style of the person.
        count: Number of strands on the scalp, before thinning at the hairline.
        long: Long hair in place of the person's style.

    Returns:
        Strands of scalp, brows and lashes.
    """
    rng = np.random.default_rng([attributes.seed, 0x4A1])
    scalp = (grow_long_hair if long else _scalp)(template, attributes, rng, count)
    knots = scalp.local.shape[1]
    parts = [scalp, *(with_knots(each(template, attributes, rng), knots) for each in (_brows, _lashes))]
    return RootedStrands(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


def _combing_direction(points: np.ndarray, normals: np.ndarray, style: str) -> np.ndarray:
    """Unit tangent along which the hair is combed."""
    x, _, z = points.T
    side = smoothstep((0.62 - normals[:, 1]) / 0.5)[:, None]  # 0 on top, 1 on the sides
    match style:
        case "side_part":
            top = displacement_field(points, 1.1 * np.tanh((x - 24.0) / 5.0), 0, 0.35 + 0.004 * z)
            down = displacement_field(points, 0, -1.0, -0.25)
        case "swept_back":
            top = displacement_field(points, 0.006 * x, 0, -1.0)
            down = displacement_field(points, 0, -0.55, -0.85)
        case _:
            angle = np.arctan2(x, z + 25.0)  # a whorl at the crown
            top = displacement_field(points, np.sin(angle), 0, 0.25 + np.cos(angle))
            down = displacement_field(points, 0, -1.0, -0.30)
    return tangential(top + side * (down - top), normals)


def _scalp(template: Template, attributes: Attributes, rng: np.random.Generator, count: int) -> RootedStrands:
    solids, style = head_solids(ear=False), attributes.style

    def noise(points: np.ndarray, scale: float, offset: int) -> np.ndarray:
        return gradient_noise(points.astype(np.float32), scale, 2, 1000 * attributes.seed + offset)

    def inside(points: np.ndarray) -> np.ndarray:
        """Height above the hairline, which is ragged."""
        return height_above_hairline(points) + 3 * noise(points, 9.0, 9)

    p = template.vertices
    density = smoothstep((inside(p) + 6) / 12) * (ear_weight(p) < 0.05) * template.on_head
    roots = sample_roots(template, density, count, rng)
    over = inside(roots.point)
    keep = over > rng.uniform(-3, 4, count)
    roots, over = roots.where(keep), over[keep]
    root, n = roots.point, len(roots.point)
    _, normal = height_and_normal(solids, root)
    top = smoothstep((root[:, 1] - 55) / 55)
    crop = 0.45 if style == "crop" else 1.0
    length = 9.0 + (crop * attributes.hair_length - 9.0) * (0.15 + 0.85 * top)
    length = length * smoothstep((over + 6) / 16) ** 0.5 * rng.uniform(0.8, 1.12, n)
    clump = np.stack([noise(root, 11.0, 20 + k) for k in range(3)], axis=1)
    stray = 0.55 * clump + 0.16 * rng.standard_normal((n, 3))
    lift = np.radians(42 if style != "crop" else 58) * (0.4 + 0.6 * top) * rng.uniform(0.6, 1.2, n)
    # Height above the scalp at which a strand comes to lie: the layers give the hair its volume.
    layer = (1.5 + 9.0 * crop * top) * rng.uniform(0.15, 1.0, n)
    points = np.empty((n, _KNOTS, 3))
    points[:, 0] = root
    step = (length / (_KNOTS - 1))[:, None]
    combed = _combing_direction(root, normal, style) + stray
    direction = unit_vectors(np.cos(lift)[:, None] * combed + np.sin(lift)[:, None] * normal)
    for k in range(1, _KNOTS):
        points[:, k] = points[:, k - 1] + step * direction
        height, normal = height_and_normal(solids, points[:, k])
        points[:, k] += normal * np.minimum(np.maximum(0.8 - height, 0)[:, None], step)
        combed = unit_vectors(_combing_direction(points[:, k], normal, style) + 0.7 * stray)
        rise = np.clip((layer - height) / (length + 1e-9) * 3.0, -0.7, 0.8)[:, None]
        direction = unit_vectors(0.45 * direction + 0.55 * unit_vectors(combed + rise * normal))
    depth = np.clip(layer / 9.0, 0, 1)[:, None]
    shade = (0.42 + 0.3 * depth) + (0.58 - 0.3 * depth) * _ALONG**0.7
    tone = (1 + 0.16 * rng.standard_normal(n) + 0.5 * clump[:, 0]).clip(0.55, 1.7)[:, None]
    colour = np.clip(np.asarray(attributes.hair) * tone * [1.03, 1.0, 0.96], 0, 1)
    return bind(template, roots, points, rng.uniform(0.6, 0.95, n), colour, shade)


def _brows(template: Template, attributes: Attributes, rng: np.random.Generator) -> RootedStrands:
    density = (brow_weight(template.vertices) > 0).astype(float)
    # Include the faces at the edge: the weight at the root decides.
    dilated = density.copy()
    np.maximum.at(dilated, template.faces, density[template.faces].max(axis=1, keepdims=True))
    roots = sample_roots(template, dilated, 2600, rng)
    threshold = rng.uniform(0.02, 0.5, len(roots.point)) / attributes.brows
    roots = roots.where(brow_weight(roots.point) > threshold)
    root, n = roots.point, len(roots.point)
    _, normal = height_and_normal(head_solids(), root)
    side = np.sign(root[:, 0])
    t = np.clip((np.abs(root[:, 0]) - 10) / 44, 0, 1)
    along = np.stack([side * (0.35 + 0.75 * t), 0.95 - 1.25 * t, -0.2 - 0.5 * t], axis=1)
    along += 0.18 * rng.standard_normal(along.shape)
    along = tangential(along, normal)
    length = rng.uniform(4.0, 7.0, n) * (1 - 0.35 * t)
    bend = along + displacement_field(root, side * 0.4, -0.5, 0)
    s = _ALONG[:, None]
    points = root[:, None] + length[:, None, None] * (
        s * along[:, None] + 0.35 * s**2 * (bend - along)[:, None] + (0.28 * s - 0.12 * s**2) * normal[:, None]
    )
    colour = np.asarray(attributes.hair) * 0.72 * (1 + 0.12 * rng.standard_normal((n, 1)))
    return bind(template, roots, points, 0.42, colour.clip(0, 1), 0.85)


def _lashes(template: Template, attributes: Attributes, rng: np.random.Generator) -> RootedStrands:
    """Lashes: their roots lie on the faces of the lid margins, close to the margin curves."""
    x, y, z = template.vertices.T
    ax, margins = np.abs(x), lid_margins(x)
    near = template.on_head & (z > 72) & (ax > 20) & (ax < 45.5) & (np.hypot(ax - 31.8, z - 69) < 17)
    near &= np.any([np.abs(y - margin) < 2.0 for margin in margins], axis=0)
    roots = sample_roots(template, near.astype(float), 2200, rng)
    x, y, z = roots.point.T
    ax, (lower, upper) = np.abs(x), lid_margins(x)
    is_upper = y > 0.5 * (lower + upper)
    distance = np.where(is_upper, np.abs(y - upper - 0.2), np.abs(y - lower + 0.2))
    in_front = z > 69 + np.sqrt(np.maximum(13.6**2 - (ax - 31.8) ** 2 - (y - 28) ** 2, 0))
    keep = (distance < 0.4) & in_front & (ax > 21) & (rng.random(len(x)) < np.where(is_upper, 0.3, 0.12))
    roots, is_upper, ax, side = roots.where(keep), is_upper[keep], ax[keep], np.sign(x[keep])
    out = np.stack([(ax - 29) / 22 * side, np.where(is_upper, 0.15, -0.35), np.ones_like(ax)], axis=1)
    out = unit_vectors(out + 0.10 * rng.standard_normal(out.shape))
    curl = np.stack([0 * ax, np.where(is_upper, 0.85, -0.25), 0 * ax], axis=1)
    length = np.where(is_upper, rng.uniform(3.0, 4.6, len(ax)), rng.uniform(1.4, 2.2, len(ax)))
    s = _ALONG[:, None]
    points = roots.point[:, None] + length[:, None, None] * (s * out[:, None] + s**2 * curl[:, None])
    return bind(template, roots, points, 0.22, np.asarray(attributes.hair) * 0.25 + 0.01, 1.0)
