"""Independent float64 reference of the mesh rasterizer: every ray against every triangle.

The ray d through a pixel meets the triangle with the corners A = [a b c] (columns, camera axes) where w = A^-1 d has no
negative number, at the depth 1 / (w_a + w_b + w_c) for a ray of unit depth (Olano and Greer 1997, "Triangle scan
conversion using 2D homogeneous coordinates"). Nothing is projected or clipped: the camera plane is no special case.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float64, Int64

from carigs.capture import Camera
from carigs.raster.rasterizer import NEAR
from stress.meshes import Mesh

TIE = 3e-7
"""Relative difference of depths up to which float32 inverse depths may be equal."""


class Seen(NamedTuple):
    """What the rays through the pixels meet first."""

    face: Int64[np.ndarray, "h w"]
    """-1 where they meet no face."""
    depth: Float64[np.ndarray, "h w"]
    """Metres, inf where they meet no face."""
    slack: Float64[np.ndarray, "h w"]
    """Range of the depth within the shifts of the ray."""
    clear: Bool[np.ndarray, "h w"]
    """Whether neither small shifts of the ray nor the rounding of depths change the face."""


def camera_points(mesh: Mesh, camera: Camera) -> Float64[np.ndarray, "v 3"]:
    """Vertices in camera axes.

    Args:
        mesh: The mesh.
        camera: The camera.

    Returns:
        Points in metres.
    """
    return mesh[0] @ camera.camera_from_world[:3, :3].T + camera.camera_from_world[:3, 3]


def pixel_rays(camera: Camera, shift: tuple[float, float] = (0.0, 0.0)) -> Float64[np.ndarray, "h w 3"]:
    """Rays of unit depth through the pixel centres, in camera axes.

    Args:
        camera: The camera.
        shift: Added to the pixel centres, in pixels.

    Returns:
        Directions.
    """
    x, y = np.meshgrid(np.arange(camera.width) + 0.5 + shift[0], np.arange(camera.height) + 0.5 + shift[1])
    return np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)


def hits(mesh: Mesh, camera: Camera, shift: tuple[float, float] = (0.0, 0.0)) -> Float64[np.ndarray, "f h w"]:
    """Depth at which the ray of each pixel meets each face.

    Args:
        mesh: The mesh.
        camera: The camera.
        shift: Added to the pixel centres, in pixels.

    Returns:
        Depths in metres, inf where a ray misses the face.
    """
    corners = camera_points(mesh, camera)[mesh[1]]
    with np.errstate(all="ignore"):
        corners = corners / np.abs(corners).max(axis=(1, 2), keepdims=True)  # squares must not overflow
        size = np.abs(camera_points(mesh, camera)[mesh[1]]).max(axis=(1, 2))
        a, b, c = corners.transpose(1, 0, 2)
        rows = np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)
        rows /= np.einsum("fi,fi->f", a, rows[:, 0])[:, None, None]
        weights = np.einsum("fki,hwi->fkhw", rows, pixel_rays(camera, shift))
        depth = size[:, None, None] / weights.sum(axis=1)
        return np.where((weights >= 0).all(axis=1) & (depth > 0) & np.isfinite(depth), depth, np.inf)


def face_volumes(mesh: Mesh, camera: Camera) -> Float64[np.ndarray, " f"]:
    """Volume that each face spans with the camera, relative to the cube of its distance.

    Args:
        mesh: The mesh.
        camera: The camera.

    Returns:
        Six times the volume: positive for faces that show their back, about 0 for those seen edge-on.
    """
    corners = camera_points(mesh, camera)[mesh[1]]
    distance = np.abs(corners).max(axis=(1, 2), initial=1e-300)
    corners = corners / distance[:, None, None]
    return np.einsum("fi,fi->f", corners[:, 0], np.cross(corners[:, 1], corners[:, 2]))


def trace(mesh: Mesh, camera: Camera, jitter: float = 1e-6) -> Seen:
    """Find the nearest face at every pixel centre.

    Args:
        mesh: The mesh.
        camera: The camera.
        jitter: Distance in pixels by which the rays are shifted to tell which pixels are clear.

    Returns:
        Faces, depths, and the pixels where these do not depend on rounding.
    """
    shifts = ((0.0, 0.0), *((x * jitter, y * jitter) for x in (-1, 1) for y in (-1, 1)))
    found, at_near_plane = [], None
    for shift in shifts:
        depths = hits(mesh, camera, shift)
        if at_near_plane is None:
            at_near_plane = (np.abs(depths / NEAR - 1) < 1e-9).any(axis=0)
        depths = np.where(depths > NEAR, depths, np.inf)
        depths = np.concatenate([depths, np.full((2, *depths.shape[1:]), np.inf)])
        first, second = np.partition(depths, 1, axis=0)[:2]
        found.append((np.where(np.isfinite(first), depths.argmin(axis=0), -1), first, second))
    faces, depths, seconds = (np.stack(values) for values in zip(*found, strict=True))
    with np.errstate(invalid="ignore"):
        clear = (faces == faces[0]).all(axis=0) & ~(seconds[0] - depths[0] <= TIE * seconds[0])
        slack = np.where(np.isfinite(depths[0]), depths.max(axis=0) - depths.min(axis=0), 0.0)
    return Seen(faces[0], depths[0], slack, clear & ~at_near_plane)
