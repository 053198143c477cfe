"""Diffuse light transfer: how much light from each direction reaches each vertex of a surface, with shadows."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from jaxtyping import Float, Float32, Int

from carigs.errors import MeshError
from carigs.hair import HairShadow
from carigs.hair.hair_shadow import WIDTH
from carigs.light.shadow_map import shadowed_cosines
from carigs.mesh.triangle_mesh import vertex_normals

SHADOW_MAP_SIDE = 160  # pixels
SHADOW_BIAS = 0.0015  # metres that points are lifted off the surface before the shadow map is looked up
SHADOW_TOLERANCE = 0.003  # metres

Transfer = Float32[np.ndarray, "v k"]


def light_transfer(
    vertices: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    directions: Float[np.ndarray, "d 3"],
    hair: HairShadow | None = None,
) -> Transfer:
    """Cosine-weighted visibility of distant light at every vertex, by one shadow map per direction (Williams 1978).

    Irradiance is transfer @ light, with the light of each direction as rows of `light`. The last column stands for
    light that the head itself reflects: it is the share of the cosines that the head hides.

    Args:
        vertices: World points in metres.
        faces: Vertex indices of the triangles.
        directions: Unit vectors towards the light in world axes.
        hair: Hair that shades the surface, if there is any. The light that it holds back is lost.

    Returns:
        Transfer (v, d + 1), scaled so that unit light from everywhere amounts to 1 on an unoccluded surface.

    Raises:
        MeshError: If the surface has no extent, or is not finite.
    """
    normals = vertex_normals(vertices, faces)
    middle = 0.5 * (vertices.min(axis=0) + vertices.max(axis=0))
    radius = 1.02 * float(np.linalg.norm(vertices - middle, axis=1).max())
    if not 1e-9 < radius < 1e9:  # the pixels of the shadow map would not be finite, either
        raise MeshError(f"a surface of {radius:g} m cannot be lit: all vertices lie in one place, or are far apart")
    transfer = np.empty((len(directions) + 1, len(vertices)), np.float32)
    axes = np.array([_map_from_world(tuple(direction)) for direction in directions], np.float32).reshape(-1, 3, 3)
    scale = np.float32(0.5 * SHADOW_MAP_SIDE / radius)
    cubes, thickness = np.zeros((0, 3), np.float32), np.zeros(0, np.float32)
    if hair is not None:
        cubes, thickness = (hair.over(vertices) - middle).astype(np.float32), hair.thickness
    shadowed_cosines(
        transfer,
        (vertices - middle).astype(np.float32),
        normals.astype(np.float32),
        faces,
        axes,
        SHADOW_MAP_SIDE,
        scale,
        np.float32(SHADOW_BIAS),
        np.float32(SHADOW_TOLERANCE),
        cubes,
        thickness,
        np.float32(WIDTH),
    )
    transfer[:-1] *= 4 / max(len(directions), 1)
    return transfer.T


@lru_cache(maxsize=1024)  # the same directions for every surface
def _map_from_world(light: tuple[float, float, float]) -> Float[np.ndarray, "3 3"]:
    """Rotation to the axes of a direction's shadow map: the third axis points away from the light."""
    direction = np.array(light)
    across = np.cross(direction, np.eye(3)[np.abs(direction).argmin()])
    across /= np.linalg.norm(across)
    return np.stack([np.cross(direction, across), across, -direction])


def fibonacci_sphere(n: int) -> Float[np.ndarray, "n 3"]:
    """Evenly spread directions: the Fibonacci lattice (Gonzalez 2010).

    Args:
        n: Number of directions.

    Returns:
        Unit vectors.
    """
    z = 1 - (2 * np.arange(n) + 1) / n
    angle, radius = np.pi * (3 - np.sqrt(5)) * np.arange(n), np.sqrt(1 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)
