"""Hair: strands grown on the template and bound to its triangles - scalp, brows, lashes.  Millimetres."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int

from carigs.toy.rig.regions import above_hairline, brow_weight, ear_weight
from carigs.toy.rig.traits import Traits
from carigs.toy.shape import sculpture
from carigs.toy.shape.falloff import smoothstep
from carigs.toy.shape.field import distances, lid_margins
from carigs.toy.shape.noise import fractal
from carigs.toy.shape.template import Template

KNOTS = 8  # points of a strand


class Strands(NamedTuple):
    """Polylines in the frame of their root's triangle."""

    face: Int[np.ndarray, "s"]
    barycentric: Float[np.ndarray, "s 3"]
    local: Float32[np.ndarray, "s k 3"]
    """Points relative to the root, in the triangle's axes (see `frames`), millimetres."""
    width: Float32[np.ndarray, "s"]
    """At the root; strands taper towards the tip."""
    colour: Float32[np.ndarray, "s 3"]
    """sRGB in [0, 1]."""
    shade: Float32[np.ndarray, "s k"]
    """How much light reaches each point through the hair around it."""


def frames(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3 3"]:
    """Rows: first edge, normal's cross with it, normal; a turn of a triangle turns its frame alike."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    edge = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.stack([edge, np.cross(normal, edge), normal], axis=1)


def grow(shape: Template, traits: Traits, count: int) -> Strands:
    """All hair of a person, `count` strands of it on the scalp."""
    rng = np.random.default_rng([traits.seed, 0x4A1])
    parts = [_scalp(shape, traits, count, rng), _brows(shape, traits, rng), _lashes(shape, traits, rng)]
    return Strands(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


def _bound(shape: Template, face: np.ndarray, weights: np.ndarray, points: np.ndarray, **fields: np.ndarray) -> Strands:
    axes = frames(shape.vertices, shape.faces)[face]
    local = np.einsum("sij,skj->ski", axes, points - points[:, :1])
    return Strands(face, weights, local.astype(np.float32), **{k: v.astype(np.float32) for k, v in fields.items()})


def _roots(
    shape: Template, density: np.ndarray, count: int, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Faces, barycentrics and positions of points spread over the skin by a density at its vertices."""
    corners = shape.vertices[shape.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    mass = np.cumsum(area * density[shape.faces].max(axis=1))
    # Stratified along the faces' order: even coverage.
    face = np.searchsorted(mass, (np.arange(count) + rng.random(count)) / count * mass[-1])
    face = np.minimum(face, len(mass) - 1)
    u, v = rng.random(count), rng.random(count)
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    weights = np.stack([1 - u - v, u, v], axis=1)
    return face, weights, np.einsum("si,sij->sj", weights, corners[face])


def _normals(rows: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Height over the head without its ears, and the direction away from it."""
    # Central differences along the corners of a tetrahedron: four samples make a gradient and a mean.
    corners = np.array([[1.0, -1, -1], [-1, -1, 1], [-1, 1, -1], [1, 1, 1]])
    around = distances(rows, (points[:, None] + 0.4 * corners).reshape(-1, 3)).reshape(-1, 4)
    return around.mean(axis=1), _unit(around @ corners)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / (np.linalg.norm(vectors, axis=-1, keepdims=True) + 1e-9)


def _flow(points: np.ndarray, normals: np.ndarray, style: str) -> np.ndarray:
    """The way the hair is combed, along the surface."""
    x, _, z = points.T
    none = np.zeros(len(points))
    side = smoothstep((0.62 - normals[:, 1]) / 0.5)[:, None]  # 0 on top, 1 on the sides
    down = np.stack([none, none - 1.0, none - 0.30], axis=1)
    match style:
        case "side_part":
            across = np.tanh((x - 24.0) / 5.0)
            top = np.stack([1.1 * across, none, 0.35 + 0.004 * z], axis=1)
            down[:, 2] = -0.25
        case "swept_back":
            top = np.stack([0.006 * x, none, none - 1.0], axis=1)
            down = np.stack([none, none - 0.55, none - 0.85], axis=1)
        case _:
            angle = np.arctan2(x, z + 25.0)  # a whorl at the crown
            top = np.stack([np.sin(angle), none, 0.25 + np.cos(angle)], axis=1)
    flow = top + side * (down - top)
    return _unit(flow - normals * (flow * normals).sum(axis=1, keepdims=True))


def _scalp(shape: Template, traits: Traits, count: int, rng: np.random.Generator) -> Strands:
    rows = sculpture.solids(without="ear")
    p = shape.vertices
    edge = above_hairline(p) + 3 * fractal(p.astype(np.float32), 9.0, 2, 1000 * traits.seed + 9)
    density = smoothstep((edge + 6) / 12) * (ear_weight(p) < 0.05) * shape.skin
    face, weights, root = _roots(shape, density, count, rng)
    over = above_hairline(root) + 3 * fractal(root.astype(np.float32), 9.0, 2, 1000 * traits.seed + 9)
    keep = over > rng.uniform(-3, 4, count)
    face, weights, root, over = face[keep], weights[keep], root[keep], over[keep]
    _, normal = _normals(rows, root)
    top = smoothstep((root[:, 1] - 55) / 55)
    crop = 0.45 if traits.style == "crop" else 1.0
    length = 9.0 + (crop * traits.hair_length - 9.0) * (0.15 + 0.85 * top)
    length = length * smoothstep((over + 6) / 16) ** 0.5 * rng.uniform(0.8, 1.12, len(root))
    clump = np.stack([fractal(root.astype(np.float32), 11.0, 2, 1000 * traits.seed + 20 + k) for k in range(3)], axis=1)
    stray = 0.55 * clump + 0.16 * rng.standard_normal((len(root), 3))
    lift = np.radians(42 if traits.style != "crop" else 58) * (0.4 + 0.6 * top) * rng.uniform(0.6, 1.2, len(root))
    # How high above the scalp a strand comes to lie: the layers make the volume.
    layer = (1.5 + 9.0 * crop * top) * rng.uniform(0.15, 1.0, len(root))
    points = np.empty((len(root), KNOTS, 3))
    points[:, 0] = root
    step = (length / (KNOTS - 1))[:, None]
    direction = _unit(
        np.cos(lift)[:, None] * (_flow(root, normal, traits.style) + stray) + np.sin(lift)[:, None] * normal
    )
    for k in range(1, KNOTS):
        points[:, k] = points[:, k - 1] + step * direction
        height, normal = _normals(rows, points[:, k])
        low = np.maximum(0.8 - height, 0)[:, None]
        points[:, k] += normal * np.minimum(low, step)
        wanted = _unit(_flow(points[:, k], normal, traits.style) + 0.7 * stray)
        rise = np.clip((layer - height) / (length + 1e-9) * 3.0, -0.7, 0.8)[:, None]
        direction = _unit(0.45 * direction + 0.55 * _unit(wanted + rise * normal))
    t = np.linspace(0, 1, KNOTS)
    depth = np.clip(layer / 9.0, 0, 1)[:, None]
    shade = (0.42 + 0.3 * depth) + (0.58 - 0.3 * depth) * t**0.7
    tone = (1 + 0.16 * rng.standard_normal(len(root)) + 0.5 * clump[:, 0]).clip(0.55, 1.7)[:, None]
    colour = np.clip(np.asarray(traits.hair) * tone * [1.03, 1.0, 0.96], 0, 1)
    width = rng.uniform(0.6, 0.95, len(root))
    return _bound(shape, face, weights, points, width=width, colour=colour, shade=shade * np.ones((len(root), 1)))


def _brows(shape: Template, traits: Traits, rng: np.random.Generator) -> Strands:
    rows = sculpture.solids()
    density = (brow_weight(shape.vertices) > 0).astype(float)
    # Faces at the edge count too; the weight at the root decides.
    face, weights, root = _roots(shape, np.maximum(density, _dilated(shape, density)), 2600, rng)
    keep = brow_weight(root) > rng.uniform(0.02, 0.5, len(root)) / traits.brows
    face, weights, root = face[keep], weights[keep], root[keep]
    _, normal = _normals(rows, root)
    ax, side = np.abs(root[:, 0]), np.sign(root[:, 0])
    t = np.clip((ax - 10) / 44, 0, 1)
    along = np.stack([side * (0.35 + 0.75 * t), 0.95 - 1.25 * t, -0.2 - 0.5 * t], axis=1)
    along += 0.18 * rng.standard_normal(along.shape)
    along = _unit(along - normal * (along * normal).sum(axis=1, keepdims=True))
    length = rng.uniform(4.0, 7.0, len(root)) * (1 - 0.35 * t)
    s = np.linspace(0, 1, KNOTS)[None, :, None]
    bend = along + np.stack([side * 0.4, -0.5 * np.ones_like(side), np.zeros_like(side)], axis=1) * s.max()
    points = root[:, None] + length[:, None, None] * (
        s * along[:, None] + 0.35 * s**2 * (bend - along)[:, None] + (0.28 * s - 0.12 * s**2) * normal[:, None]
    )
    colour = np.asarray(traits.hair) * 0.72 * (1 + 0.12 * rng.standard_normal((len(root), 1)))
    ones = np.ones(len(root))
    return _bound(
        shape,
        face,
        weights,
        points,
        width=0.42 * ones,
        colour=colour.clip(0, 1),
        shade=np.full((len(root), KNOTS), 0.85),
    )


def _dilated(shape: Template, values: np.ndarray) -> np.ndarray:
    grown = values.copy()
    np.maximum.at(grown, shape.faces, values[shape.faces].max(axis=1, keepdims=True))
    return grown


def _lashes(shape: Template, traits: Traits, rng: np.random.Generator) -> Strands:
    """Roots on the faces of the lid margins, where they are nearest to the margin curves."""
    x, y, z = shape.vertices.T
    lower, upper = lid_margins.py_func(x)
    ax = np.abs(x)
    near = shape.skin & (z > 72) & (ax > 20) & (ax < 45.5) & (np.hypot(ax - 31.8, z - 69) < 17)
    near &= (np.abs(y - upper) < 2.0) | (np.abs(y - lower) < 2.0)
    face, weights, root = _roots(shape, near.astype(float), 2200, rng)
    lower, upper = lid_margins.py_func(root[:, 0])
    ax, side = np.abs(root[:, 0]), np.sign(root[:, 0])
    is_upper = root[:, 1] > 0.5 * (lower + upper)
    off = np.where(is_upper, np.abs(root[:, 1] - upper - 0.2), np.abs(root[:, 1] - lower + 0.2))
    ahead = root[:, 2] > 69 + np.sqrt(np.maximum(13.6**2 - (ax - 31.8) ** 2 - (root[:, 1] - 28) ** 2, 0))
    keep = (off < 0.4) & ahead & (ax > 21) & (rng.random(len(root)) < np.where(is_upper, 0.3, 0.12))
    face, weights, root = face[keep], weights[keep], root[keep]
    side, is_upper, ax = side[keep], is_upper[keep], ax[keep]
    out = np.stack([(ax - 29) / 22 * side, np.where(is_upper, 0.15, -0.35), np.ones_like(ax)], axis=1)
    out = _unit(out + 0.10 * rng.standard_normal(out.shape))
    curl = np.stack([0 * ax, np.where(is_upper, 0.85, -0.25), 0 * ax], axis=1)
    length = np.where(is_upper, rng.uniform(3.0, 4.6, len(root)), rng.uniform(1.4, 2.2, len(root)))
    s = np.linspace(0, 1, KNOTS)[None, :, None]
    points = root[:, None] + length[:, None, None] * (s * out[:, None] + s**2 * curl[:, None])
    colour = np.tile(np.asarray(traits.hair) * 0.25 + 0.01, (len(root), 1))
    return _bound(
        shape, face, weights, points, width=0.22 * np.ones(len(root)), colour=colour, shade=np.ones((len(root), KNOTS))
    )
