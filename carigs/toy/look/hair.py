"""Hair strands on scalp, brows and lids, grown on the template and bound to its triangles. Lengths in millimetres."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, Int

from carigs.toy.rig.attributes import Attributes
from carigs.toy.rig.regions import brow_weight, ear_weight, height_above_hairline
from carigs.toy.shape.anatomy import lid_margins
from carigs.toy.shape.falloff import displacement_field
from carigs.toy.shape.head_solids import head_solids
from carigs.toy.shape.noise import gradient_noise
from carigs.toy.shape.signed_distance import smoothstep, solids_distance
from carigs.toy.shape.template import Template

_KNOTS = 8  # points of a strand
_ALONG = np.linspace(0, 1, _KNOTS)  # position of the knots on it


class Strands(NamedTuple):
    """Polylines in the frames of the triangles that their roots lie on."""

    face: Int[np.ndarray, " s"]
    barycentric: Float[np.ndarray, "s 3"]
    """Position of the root on its face."""
    local: Float32[np.ndarray, "s k 3"]
    """Points relative to the root, in the triangle's frame (see `triangle_frames`), millimetres."""
    width: Float32[np.ndarray, " s"]
    """Width at the root, in millimetres; strands taper towards the tip."""
    colour: Float32[np.ndarray, "s 3"]
    """sRGB in [0, 1]."""
    shade: Float32[np.ndarray, "s k"]
    """Share of light that reaches each point through the hair around it."""


class _Roots(NamedTuple):
    face: np.ndarray
    barycentric: np.ndarray
    point: np.ndarray

    def where(self, keep: np.ndarray) -> _Roots:
        return _Roots(self.face[keep], self.barycentric[keep], self.point[keep])


def triangle_frames(vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"]) -> Float[np.ndarray, "f 3 3"]:
    """Orthonormal frames of triangles.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles.

    Returns:
        Axes as rows: direction of the first edge, cross product of normal and first edge, normal.
    """
    a, b, c = vertices[faces.T]
    edge = (b - a) / np.linalg.norm(b - a, axis=1, keepdims=True)
    normal = np.cross(b - a, c - a)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    return np.stack([edge, np.cross(normal, edge), normal], axis=1)


def grow_hair(template: Template, attributes: Attributes, count: int) -> Strands:
    """Grow all hair of a person.

    Args:
        template: The template mesh, in millimetres.
        attributes: Seed, colours and hair style of the person.
        count: Number of strands on the scalp, before thinning at the hairline.

    Returns:
        Strands of scalp, brows and lashes.
    """
    rng = np.random.default_rng([attributes.seed, 0x4A1])
    scalp = _scalp(template, attributes, rng, count)
    parts = [scalp, _brows(template, attributes, rng), _lashes(template, attributes, rng)]
    return Strands(*(np.concatenate(fields) for fields in zip(*parts, strict=True)))


def _bind(template: Template, roots: _Roots, points: np.ndarray, width, colour, shade) -> Strands:
    """Bind strands to the triangles of their roots; width, colour and shade are broadcast."""
    axes = triangle_frames(template.vertices, template.faces)[roots.face]
    local = np.einsum("sij,skj->ski", axes, points - points[:, :1]).astype(np.float32)
    n, knots, _ = points.shape
    shapes = ((width, (n,)), (colour, (n, 3)), (shade, (n, knots)))
    rest = (np.broadcast_to(value, shape).astype(np.float32, order="C") for value, shape in shapes)
    return Strands(roots.face, roots.barycentric, local, *rest)


def _sample_roots(template: Template, density: np.ndarray, count: int, rng: np.random.Generator) -> _Roots:
    """Random points on the template, with a density that is given at its vertices."""
    corners = template.vertices[template.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    mass = np.cumsum(area * density[template.faces].max(axis=1))
    # Stratified in the order of the faces, for even coverage.
    face = np.searchsorted(mass[:-1], (np.arange(count) + rng.random(count)) / count * mass[-1])
    u, v = rng.random(count), rng.random(count)
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    weights = np.stack([1 - u - v, u, v], axis=1)
    return _Roots(face, weights, np.einsum("si,sij->sj", weights, corners[face]))


def _height_and_normal(solids: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Height above the solids, and the unit normal there."""
    # Differences along the corners of a tetrahedron: four samples give the gradient and the mean.
    corners = np.array([[1.0, -1, -1], [-1, -1, 1], [-1, 1, -1], [1, 1, 1]])
    around = solids_distance(solids, (points[:, None] + 0.4 * corners).reshape(-1, 3)).reshape(-1, 4)
    return around.mean(axis=1), _unit(around @ corners)


def _unit(vectors: np.ndarray) -> np.ndarray:
    return vectors / (np.linalg.norm(vectors, axis=-1, keepdims=True) + 1e-9)


def _tangential(vectors: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Unit vectors of the tangential parts."""
    return _unit(vectors - normals * (vectors * normals).sum(axis=1, keepdims=True))


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
    return _tangential(top + side * (down - top), normals)


def _scalp(template: Template, attributes: Attributes, rng: np.random.Generator, count: int) -> Strands:
    solids, style = head_solids(ear=False), attributes.style

    def noise(points: np.ndarray, scale: float, offset: int) -> np.ndarray:
        return gradient_noise(points.astype(np.float32), scale, 2, 1000 * attributes.seed + offset)

    def inside(points: np.ndarray) -> np.ndarray:
        """Height above the hairline, which is ragged."""
        return height_above_hairline(points) + 3 * noise(points, 9.0, 9)

    p = template.vertices
    density = smoothstep((inside(p) + 6) / 12) * (ear_weight(p) < 0.05) * template.on_head
    roots = _sample_roots(template, density, count, rng)
    over = inside(roots.point)
    keep = over > rng.uniform(-3, 4, count)
    roots, over = roots.where(keep), over[keep]
    root, n = roots.point, len(roots.point)
    _, normal = _height_and_normal(solids, root)
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
    direction = _unit(np.cos(lift)[:, None] * combed + np.sin(lift)[:, None] * normal)
    for k in range(1, _KNOTS):
        points[:, k] = points[:, k - 1] + step * direction
        height, normal = _height_and_normal(solids, points[:, k])
        points[:, k] += normal * np.minimum(np.maximum(0.8 - height, 0)[:, None], step)
        combed = _unit(_combing_direction(points[:, k], normal, style) + 0.7 * stray)
        rise = np.clip((layer - height) / (length + 1e-9) * 3.0, -0.7, 0.8)[:, None]
        direction = _unit(0.45 * direction + 0.55 * _unit(combed + rise * normal))
    depth = np.clip(layer / 9.0, 0, 1)[:, None]
    shade = (0.42 + 0.3 * depth) + (0.58 - 0.3 * depth) * _ALONG**0.7
    tone = (1 + 0.16 * rng.standard_normal(n) + 0.5 * clump[:, 0]).clip(0.55, 1.7)[:, None]
    colour = np.clip(np.asarray(attributes.hair) * tone * [1.03, 1.0, 0.96], 0, 1)
    return _bind(template, roots, points, rng.uniform(0.6, 0.95, n), colour, shade)


def _brows(template: Template, attributes: Attributes, rng: np.random.Generator) -> Strands:
    density = (brow_weight(template.vertices) > 0).astype(float)
    # Include the faces at the edge: the weight at the root decides.
    dilated = density.copy()
    np.maximum.at(dilated, template.faces, density[template.faces].max(axis=1, keepdims=True))
    roots = _sample_roots(template, dilated, 2600, rng)
    threshold = rng.uniform(0.02, 0.5, len(roots.point)) / attributes.brows
    roots = roots.where(brow_weight(roots.point) > threshold)
    root, n = roots.point, len(roots.point)
    _, normal = _height_and_normal(head_solids(), root)
    side = np.sign(root[:, 0])
    t = np.clip((np.abs(root[:, 0]) - 10) / 44, 0, 1)
    along = np.stack([side * (0.35 + 0.75 * t), 0.95 - 1.25 * t, -0.2 - 0.5 * t], axis=1)
    along += 0.18 * rng.standard_normal(along.shape)
    along = _tangential(along, normal)
    length = rng.uniform(4.0, 7.0, n) * (1 - 0.35 * t)
    bend = along + displacement_field(root, side * 0.4, -0.5, 0)
    s = _ALONG[:, None]
    points = root[:, None] + length[:, None, None] * (
        s * along[:, None] + 0.35 * s**2 * (bend - along)[:, None] + (0.28 * s - 0.12 * s**2) * normal[:, None]
    )
    colour = np.asarray(attributes.hair) * 0.72 * (1 + 0.12 * rng.standard_normal((n, 1)))
    return _bind(template, roots, points, 0.42, colour.clip(0, 1), 0.85)


def _lashes(template: Template, attributes: Attributes, rng: np.random.Generator) -> Strands:
    """Lashes: their roots lie on the faces of the lid margins, close to the margin curves."""
    x, y, z = template.vertices.T
    ax, margins = np.abs(x), lid_margins(x)
    near = template.on_head & (z > 72) & (ax > 20) & (ax < 45.5) & (np.hypot(ax - 31.8, z - 69) < 17)
    near &= np.any([np.abs(y - margin) < 2.0 for margin in margins], axis=0)
    roots = _sample_roots(template, near.astype(float), 2200, rng)
    x, y, z = roots.point.T
    ax, (lower, upper) = np.abs(x), lid_margins(x)
    is_upper = y > 0.5 * (lower + upper)
    distance = np.where(is_upper, np.abs(y - upper - 0.2), np.abs(y - lower + 0.2))
    in_front = z > 69 + np.sqrt(np.maximum(13.6**2 - (ax - 31.8) ** 2 - (y - 28) ** 2, 0))
    keep = (distance < 0.4) & in_front & (ax > 21) & (rng.random(len(x)) < np.where(is_upper, 0.3, 0.12))
    roots, is_upper, ax, side = roots.where(keep), is_upper[keep], ax[keep], np.sign(x[keep])
    out = np.stack([(ax - 29) / 22 * side, np.where(is_upper, 0.15, -0.35), np.ones_like(ax)], axis=1)
    out = _unit(out + 0.10 * rng.standard_normal(out.shape))
    curl = np.stack([0 * ax, np.where(is_upper, 0.85, -0.25), 0 * ax], axis=1)
    length = np.where(is_upper, rng.uniform(3.0, 4.6, len(ax)), rng.uniform(1.4, 2.2, len(ax)))
    s = _ALONG[:, None]
    points = roots.point[:, None] + length[:, None, None] * (s * out[:, None] + s**2 * curl[:, None])
    return _bind(template, roots, points, 0.22, np.asarray(attributes.hair) * 0.25 + 0.01, 1.0)
