"""Ambient occlusion of the vertices of a mesh by the mesh itself, with a cache on disk."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.errors import InputError
from carigs.mesh.ray_caster import RayCaster
from carigs.mesh.triangle_mesh import barycenters, face_areas, neighbour_pairs, size, vertex_normals
from carigs.readers.npz import read_npy
from carigs.system.cache_folders import cache_folders, first_usable
from carigs.system.files import writing

RAYS = 64
"""Rays from each vertex."""
RAY_OFFSET = 1e-4
"""Distance of the rays' origins from the surface, in units of the mesh's size."""
MAX_CACHED_MESHES = 200
"""Number of meshes in the cache; the oldest are removed."""


def ambient_occlusion(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    rays: int = RAYS,
    at: Bool[np.ndarray, " v"] | None = None,
) -> Float[np.ndarray, " v"]:
    """Share of the hemisphere above each vertex that the surface hides, averaged once with the neighbours.

    The pattern of rays is aligned with the vertex normal and the direction to the surface's centroid, so a rotation of
    the mesh does not change the result.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles, counterclockwise seen from outside.
        rays: Number of rays from each vertex, evenly distributed over the solid angle.
        at: Vertices to evaluate (None: all). The others get 0 before averaging, but they occlude.

    Returns:
        Occlusion in [0, 1]: 0 on a convex surface, near 1 deep in a cavity.
    """
    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
    vertices = vertices - vertices[0]
    at = np.ones(len(vertices), bool) if at is None else at
    extent = size(vertices, faces)
    positions, normals = vertices[at], vertex_normals(vertices, faces)[at]
    centroid = np.average(barycenters(vertices, faces), axis=0, weights=face_areas(vertices, faces))
    inwards = centroid - positions
    tangents = inwards - (inwards * normals).sum(axis=1, keepdims=True) * normals
    tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-300)
    frames = np.stack([tangents, np.cross(normals, tangents), normals], axis=1)
    directions = _fibonacci_hemisphere(rays) @ frames
    origins = np.repeat(positions / extent + RAY_OFFSET * normals, rays, axis=0)
    hit, *_ = RayCaster(vertices, faces).first_hit(origins, directions.reshape(-1, 3))
    occlusion = np.zeros(len(vertices))
    occlusion[at] = (hit.reshape(-1, rays) >= 0).mean(axis=1)
    i, j = neighbour_pairs(faces)
    return (occlusion + np.bincount(i, occlusion[j], len(occlusion))) / (1 + np.bincount(i, minlength=len(occlusion)))


def cached_ambient_occlusion(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], at: Bool[np.ndarray, " v"]
) -> Float[np.ndarray, " v"]:
    """`ambient_occlusion`, cached in the folder `occlusion` of `carigs.system.cache_folders`.

    The key is a digest of the mesh and of the code. An entry that cannot be read is computed again; if the cache cannot
    be written, nothing is cached.

    Args:
        vertices: Positions, in any unit.
        faces: Vertex indices of the triangles, counterclockwise seen from outside.
        at: Vertices to evaluate.

    Returns:
        Occlusion in [0, 1].
    """
    digest = hashlib.sha256()
    for module in ("ambient_occlusion", "ray_caster", "triangle_mesh"):  # other code, another key
        digest.update(Path(__file__).with_name(f"{module}.py").read_bytes())
    for array in (vertices, faces, at):
        digest.update(np.ascontiguousarray(array))
    folder, _ = first_usable(cache_folders("occlusion"))
    if folder is None:
        return ambient_occlusion(vertices, faces, at=at)
    file = folder / f"{digest.hexdigest()[:32]}.npy"
    try:
        occlusion = read_npy(file)
        if occlusion.shape == (len(vertices),) and np.isfinite(occlusion).all():
            return occlusion
    except InputError:
        pass
    occlusion = ambient_occlusion(vertices, faces, at=at)
    try:
        with writing(file) as part:
            np.save(part, occlusion)
        for old in sorted(folder.glob("*.npy"), key=lambda entry: entry.stat().st_mtime)[:-MAX_CACHED_MESHES]:
            old.unlink(missing_ok=True)
    except OSError:
        pass  # the disk is full or read-only
    return occlusion


def _fibonacci_hemisphere(n: int) -> Float[np.ndarray, "n 3"]:
    """Evenly distributed unit vectors with z > 0: the Fibonacci lattice (Gonzalez 2010)."""
    k = np.arange(n)
    z = (k + 0.5) / n
    angle, radius = 2 * np.pi * (k * (np.sqrt(5) - 1) / 2 % 1), np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
