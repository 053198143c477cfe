"""Ambient occlusion: how much of the hemisphere over a vertex the surface itself hides."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.files import writing
from carigs.mesh.ray_caster import RayCaster
from carigs.mesh.triangle_mesh import barycenters, face_areas, size, vertex_normals

RAYS = 64
OFFSET = 1e-4
"""Of the head's size: rays start this far off the surface."""
KEEP = 200
"""Meshes whose occlusion stays in the cache: the latest."""


def ambient_occlusion(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    rays: int = RAYS,
    at: Bool[np.ndarray, " v"] | None = None,
) -> Float[np.ndarray, " v"]:
    """Share of hidden directions, 0 on a convex surface, near 1 deep in a cavity; averaged once over neighbours.

    Only the vertices `at` are looked from (default: all); the others get 0, but hide.  All look the same way relative
    to their normal and the surface's middle, so that a turned mesh sees the same.
    """
    vertices, faces = np.asarray(vertices, np.float64), np.asarray(faces, np.int64)
    vertices = vertices - vertices[0]
    at = np.ones(len(vertices), bool) if at is None else at
    extent = size(vertices, faces)
    places, normals = vertices[at], vertex_normals(vertices, faces)[at]
    middle = np.average(barycenters(vertices, faces), axis=0, weights=face_areas(vertices, faces))
    inwards = middle - places
    tangents = inwards - (inwards * normals).sum(axis=1, keepdims=True) * normals
    tangents /= np.maximum(np.linalg.norm(tangents, axis=1, keepdims=True), 1e-300)
    frames = np.stack([tangents, np.cross(normals, tangents), normals], axis=1)
    directions = hemisphere(rays) @ frames
    origins = np.repeat(places / extent + OFFSET * normals, rays, axis=0)
    hit, *_ = RayCaster(vertices, faces).first(origins, directions.reshape(-1, 3))
    hidden = np.zeros(len(vertices))
    hidden[at] = (hit.reshape(-1, rays) >= 0).mean(axis=1)
    i, j = faces[:, [0, 1, 2]].ravel(), faces[:, [1, 2, 0]].ravel()
    i, j = np.concatenate([i, j]), np.concatenate([j, i])
    return (hidden + np.bincount(i, hidden[j], len(hidden))) / (1 + np.bincount(i, minlength=len(hidden)))


def cached_occlusion(
    vertices: Float[np.ndarray, "v 3"], faces: Int[np.ndarray, "f 3"], at: Bool[np.ndarray, " v"]
) -> Float[np.ndarray, " v"]:
    """`ambient_occlusion`, kept on disk by the mesh's bytes; an entry that cannot be read is made again."""
    digest = hashlib.sha256()
    for module in ("ambient_occlusion", "ray_caster", "triangle_mesh"):  # another program, another cache
        digest.update(Path(__file__).with_name(f"{module}.py").read_bytes())
    for array in (vertices, faces, at):
        digest.update(np.ascontiguousarray(array))
    folder = cache_folder()
    file = folder / f"{digest.hexdigest()[:32]}.npy"
    try:
        hidden = np.load(file, allow_pickle=False)
        if hidden.shape == (len(vertices),) and np.isfinite(hidden).all():
            return hidden
    except (OSError, ValueError, EOFError):
        pass
    hidden = ambient_occlusion(vertices, faces, at=at)
    try:
        with writing(file) as part:
            np.save(part, hidden)
        for old in sorted(folder.glob("*.npy"), key=lambda entry: entry.stat().st_mtime)[:-KEEP]:
            old.unlink(missing_ok=True)
    except OSError:
        pass  # a full or read-only disk: then without a cache
    return hidden


def cache_folder() -> Path:
    """Where occlusion is kept: below XDG_CACHE_HOME, else ~/.cache."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "carigs" / "occlusion"


def hemisphere(n: int) -> Float[np.ndarray, "n 3"]:
    """Evenly spread unit vectors with z > 0 (Fibonacci's lattice, Gonzalez 2010)."""
    k = np.arange(n)
    z = (k + 0.5) / n
    angle, radius = 2 * np.pi * (k * (np.sqrt(5) - 1) / 2 % 1), np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def smoothstep(x: Float[np.ndarray, " n"], low: float, high: float) -> Float[np.ndarray, " n"]:
    """0 below `low`, 1 above `high`, a cubic between."""
    t = np.clip((x - low) / (high - low), 0, 1)
    return t * t * (3 - 2 * t)
