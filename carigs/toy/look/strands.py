"""Hair strands: polylines bound to the triangles that their roots lie on, and what growing them needs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Float32, Int
from scipy.spatial.distance import cdist

from carigs.toy.shape.signed_distance import solids_distance
from carigs.toy.shape.template import Template


class RootedStrands(NamedTuple):
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


class Roots(NamedTuple):
    """Points of the template that strands grow from."""

    face: Int[np.ndarray, " s"]
    barycentric: Float[np.ndarray, "s 3"]
    point: Float[np.ndarray, "s 3"]
    """Millimetres."""

    def where(self, keep: Bool[np.ndarray, " s"]) -> Roots:
        """Some of the roots.

        Args:
            keep: Roots to keep.

        Returns:
            Those roots.
        """
        return Roots(self.face[keep], self.barycentric[keep], self.point[keep])


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


def smooth_frames(
    template: Float[np.ndarray, "v 3"],
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    roots: Int[np.ndarray, " s"],
    radius: float,
) -> Float[np.ndarray, "s 3 3"]:
    """Frames of the triangles of long strands, whose rotations are averaged: neighbouring strands move together.

    Args:
        template: Vertices of the template.
        vertices: Vertices of the posed head.
        faces: Vertex indices of the triangles.
        roots: Triangle of each strand.
        radius: Standard deviation of the average on the template, in its unit.

    Returns:
        The frames of the template, turned by the averages.
    """
    used, of_strand = np.unique(roots, return_inverse=True)
    before, after = (triangle_frames(each, faces[used]) for each in (template, vertices))
    centres = template[faces[used]].mean(axis=1)
    weight = np.exp(-0.5 * (cdist(centres, centres) / radius) ** 2)
    turn = np.einsum("fki,fkj->fij", before, after).reshape(-1, 9)  # row vectors: after = before @ turn
    left, _, right = np.linalg.svd((weight @ turn).reshape(-1, 3, 3))
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]  # the nearest rotation
    return (before @ left @ right)[of_strand]


def with_knots(strands: RootedStrands, knots: int) -> RootedStrands:
    """Strands with another number of points, which lie on the same polylines.

    Args:
        strands: The strands.
        knots: Number of points.

    Returns:
        The strands; the same if they have this number of points.
    """
    k = strands.local.shape[1]
    if k == knots:
        return strands
    place = np.linspace(0, k - 1, knots)
    index = np.minimum(place.astype(int), k - 2)
    share = (place - index).astype(np.float32)
    local, shade = (
        (1 - w) * values[:, index] + w * values[:, index + 1]
        for values, w in ((strands.local, share[:, None]), (strands.shade, share))
    )
    return strands._replace(local=local, shade=shade)


def bind(template: Template, roots: Roots, points: np.ndarray, width, colour, shade) -> RootedStrands:
    """Bind strands to the triangles of their roots.

    Args:
        template: The template mesh.
        roots: Roots of the strands.
        points: Points of the strands (s, k, 3), from the root on, in millimetres.
        width: Width at the root; this and the next two are broadcast.
        colour: sRGB in [0, 1].
        shade: Share of light at each point.

    Returns:
        The strands.
    """
    axes = triangle_frames(template.vertices, template.faces)[roots.face]
    local = np.einsum("sij,skj->ski", axes, points - points[:, :1]).astype(np.float32)
    n, knots, _ = points.shape
    shapes = ((width, (n,)), (colour, (n, 3)), (shade, (n, knots)))
    rest = (np.broadcast_to(value, shape).astype(np.float32, order="C") for value, shape in shapes)
    return RootedStrands(roots.face, roots.barycentric, local, *rest)


def sample_roots(template: Template, density: np.ndarray, count: int, rng: np.random.Generator) -> Roots:
    """Random points on the template.

    Args:
        template: The template mesh.
        density: Density of the points at its vertices.
        count: Number of points.
        rng: Draws them.

    Returns:
        The points.
    """
    corners = template.vertices[template.faces]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    mass = np.cumsum(area * density[template.faces].max(axis=1))
    # Stratified in the order of the faces, for even coverage.
    face = np.searchsorted(mass[:-1], (np.arange(count) + rng.random(count)) / count * mass[-1])
    u, v = rng.random(count), rng.random(count)
    over = u + v > 1
    u, v = np.where(over, 1 - u, u), np.where(over, 1 - v, v)
    weights = np.stack([1 - u - v, u, v], axis=1)
    return Roots(face, weights, np.einsum("si,sij->sj", weights, corners[face]))


def height_and_normal(solids: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Height above solids, and the direction in which it grows.

    Args:
        solids: The solids (see `carigs.toy.shape.solids`).
        points: Points (n, 3) in millimetres.

    Returns:
        Heights in millimetres, and unit normals.
    """
    # Differences along the corners of a tetrahedron: four samples give the gradient and the mean.
    corners = np.array([[1.0, -1, -1], [-1, -1, 1], [-1, 1, -1], [1, 1, 1]])
    around = solids_distance(solids, (points[:, None] + 0.4 * corners).reshape(-1, 3)).reshape(-1, 4)
    return around.mean(axis=1), unit_vectors(around @ corners)


def unit_vectors(vectors: np.ndarray) -> np.ndarray:
    """Vectors of length 1.

    Args:
        vectors: Vectors (..., 3).

    Returns:
        Their directions; 0 for a vector of length 0.
    """
    return vectors / (np.linalg.norm(vectors, axis=-1, keepdims=True) + 1e-9)


def tangential(vectors: np.ndarray, normals: np.ndarray) -> np.ndarray:
    """Directions of the tangential parts of vectors.

    Args:
        vectors: Vectors (n, 3).
        normals: Unit normals (n, 3).

    Returns:
        Unit vectors.
    """
    return unit_vectors(vectors - normals * (vectors * normals).sum(axis=1, keepdims=True))
