"""Colours of an avatar at the vertices of its mesh, for programs that draw meshes and no surfels.

The avatar is rendered from all around. Each vertex takes the mean of the images that show it, most of it from where it
is seen squarely. What no image shows, such as the inside of the mouth, continues its surroundings.
"""

from __future__ import annotations

import numpy as np
from jaxtyping import Float, Float32
from scipy.ndimage import binary_erosion

from carigs.capture import Camera, look_at
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.raster import compute_visibility
from carigs.raster.vertex_colours import sample_colours, visible_vertices
from carigs.splat.avatar import Avatar

SIZE = 1024
"""Pixels of the images along a side."""
VIEWS = ((0, 0), (30, 0), (-30, 0), (65, 0), (-65, 0), (110, 5), (-110, 5), (180, 5), (0, 35), (0, -30), (180, 50))
"""Azimuth and elevation in degrees."""
MARGIN, FIELD_OF_VIEW = 1.3, 20.0
"""Size of an image over that of the head, and degrees from its top to its bottom."""
RIM, RIM_SHARE = 4, 1e-3
"""Pixels along the outline of the mesh, where the background shines through, and their weight."""
SHARPNESS = 6
"""Power of the cosine between normal and direction of view that weights an image."""


def baked_colours(avatar: Avatar, vertices: Float[np.ndarray, "v 3"]) -> Float32[np.ndarray, "v 3"]:
    """Find the colours of the vertices.

    Args:
        avatar: The avatar.
        vertices: The posed mesh at a level, in world coordinates (metres).

    Returns:
        sRGB in [0, 1].
    """
    sequence = avatar.sequence
    motion, shade = sequence.motion_of(vertices), sequence.shade_of(vertices)
    faces = sequence.head.faces
    normals = vertex_normals(vertices, faces)
    total, weight = np.zeros((len(vertices), 3)), np.zeros(len(vertices))
    for camera in _cameras(vertices):
        image = avatar.render_motion(motion, shade, camera).image.numpy().clip(0, 1)
        visibility = compute_visibility(vertices, faces, camera)
        seen = visible_vertices(visibility, vertices, normals)
        inner = binary_erosion(visibility.face >= 0, iterations=RIM)
        column, row = seen.pixels.astype(int).T
        share = seen.cosine**SHARPNESS * np.where(inner[row, column], 1.0, RIM_SHARE)
        total[seen.index] += share[:, None] * sample_colours(image, seen.pixels)[0]
        weight[seen.index] += share
    return _continued(total, weight, faces).astype(np.float32).clip(0, 1)


def linear_colours(srgb: Float[np.ndarray, "v 3"]) -> Float32[np.ndarray, "v 3"]:
    """Linear values of sRGB colours (IEC 61966-2-1), as glTF stores colours of vertices.

    Args:
        srgb: Values in [0, 1].

    Returns:
        Values in [0, 1].
    """
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4).astype(np.float32)


def _cameras(vertices: Float[np.ndarray, "v 3"]) -> list[Camera]:
    """Cameras around the head that show all of it."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle, extent = 0.5 * (low + high), float((high - low).max())
    tangent = np.tan(np.radians(FIELD_OF_VIEW / 2))
    distance, focal = 0.5 * MARGIN * extent / tangent + 0.5 * extent, 0.5 * SIZE / tangent
    cameras = []
    for azimuth, elevation in np.radians(VIEWS):
        out = np.array([np.sin(azimuth) * np.cos(elevation), np.sin(elevation), np.cos(azimuth) * np.cos(elevation)])
        camera_from_world = look_at(middle + distance * out, middle)
        cameras.append(Camera(camera_from_world, focal, focal, SIZE / 2, SIZE / 2, SIZE, SIZE))
    return cameras


def _continued(
    total: Float[np.ndarray, "v 3"], weight: Float[np.ndarray, " v"], faces: np.ndarray
) -> Float[np.ndarray, "v 3"]:
    """Colours of seen vertices; others take the mean of their neighbours, ring by ring, then the overall mean."""
    colour, known = total / np.maximum(weight, 1e-12)[:, None], weight > 1e-8
    start = np.concatenate([faces[:, i] for i in (0, 1, 2, 1, 2, 0)])
    end = np.concatenate([faces[:, i] for i in (1, 2, 0, 0, 1, 2)])
    while True:
        across = known[end] & ~known[start]
        if not across.any():
            break
        count = np.bincount(start[across], minlength=len(known))
        sums = [np.bincount(start[across], colour[end[across], c], len(known)) for c in range(3)]
        new = count > 0
        colour[new] = (np.stack(sums, axis=1) / np.maximum(count, 1)[:, None])[new]
        known = known | new
    if known.any():
        colour[~known] = colour[known].mean(axis=0)
    else:
        colour[:] = 0.5
    return colour
