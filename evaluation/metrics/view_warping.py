"""Warp one view of a surface to another: where a point of the mesh is seen in the other image, if it is.

Points are left out where the mesh hides them in the other view, and where either image cannot show them well: near an
outline or a jump in depth, and on surface that is seen at a grazing angle.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from carigs.capture import Camera
from carigs.raster import Visibility

DEPTH_TOLERANCE = 0.003
"""Metres between a point and the surface that its pixel in the other view shows, up to which it is the same point."""
MAX_SLOPE = float(np.tan(np.radians(70)))
"""Largest change of depth per distance across the line of sight, over the neighbouring pixels."""


class Correspondence(NamedTuple):
    """Pixels of one view that another view shows as well."""

    seen: Bool[np.ndarray, "h w"]
    """Whether the other view shows the point."""
    pixels: Float32[np.ndarray, "n 2"]
    """Position (x, y) of each seen point in the other image, in the order of the pixels; pixel centres at +0.5."""

    def difference(
        self, image: UInt8[np.ndarray, "h w 3"], other: UInt8[np.ndarray, "k l 3"]
    ) -> Float32[np.ndarray, " n"]:
        """Absolute difference of the two images at the seen points.

        Args:
            image: Image of the view.
            other: Image of the other view, sampled bilinearly.

        Returns:
            Mean over the channels, for values in [0, 1], of each seen pixel.
        """
        if len(self.pixels) == 0:
            return np.zeros(0, np.float32)
        # OpenCV limits the sides of its maps to 32 767 and counts pixel centres from 0.
        rows = np.array_split(self.pixels - np.float32(0.5), -(-len(self.pixels) // 32_000))
        colours = other.astype(np.float32)
        sampled = [cv2.remap(colours, part[:, None], None, cv2.INTER_LINEAR)[:, 0] for part in rows]
        red, green, blue = np.abs(image[self.seen] - np.concatenate(sampled)).T
        return (red + green + blue) / np.float32(3 * 255)


def correspondence(view: Visibility, other: Visibility) -> Correspondence:
    """Find where another view shows the points of a view.

    Args:
        view: A mesh as one camera sees it.
        other: The same mesh, at the same timestep, as another camera sees it.

    Returns:
        The pixels of `view` whose points `other` shows, too.
    """
    rows, columns = np.nonzero(well_seen(view))
    fx, fy, cx, cy = view.camera.intrinsics
    depth = 1 / view.inverse_depth[rows, columns].astype(np.float64)
    points = np.stack([(columns + 0.5 - cx) / fx * depth, (rows + 0.5 - cy) / fy * depth, depth])
    other_from_view = other.camera.camera_from_world @ view.camera.world_from_camera
    x, y, z = other_from_view[:3, :3] @ points + other_from_view[:3, 3:]
    fx, fy, cx, cy = other.camera.intrinsics
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = fx * x / z + cx, fy * y / z + cy
    inside = (z > 0) & (u >= 0.5) & (v >= 0.5) & (u < other.camera.width - 0.5) & (v < other.camera.height - 0.5)
    rows, columns, u, v, z = (values[inside] for values in (rows, columns, u, v, z))
    column, row = u.astype(int), v.astype(int)
    # The plane of the face there, at the point's own position: exact also between pixel centres.
    slope_u, slope_v, constant = other.depth_planes[other.face[row, column]].T
    inverse_depth = slope_u * u + slope_v * v + constant
    same = well_seen(other)[row, column] & (np.abs(inverse_depth * z - 1) < DEPTH_TOLERANCE * inverse_depth)
    seen = np.zeros(view.face.shape, bool)
    seen[rows[same], columns[same]] = True
    return Correspondence(seen, np.stack([u[same], v[same]], axis=1).astype(np.float32))


def well_seen(visibility: Visibility) -> Bool[np.ndarray, "h w"]:
    """Pixels that show the mesh, away from its outline, jumps in depth and grazing angles.

    Args:
        visibility: The mesh as a camera sees it.

    Returns:
        Whether the depth changes by at most `MAX_SLOPE` per distance across, over the 3 x 3 pixels around.
    """
    inverse, square = visibility.inverse_depth, np.ones((3, 3), np.uint8)
    nearest, farthest = cv2.dilate(inverse, square), cv2.erode(inverse, square)
    # 1/z changes by dz / z^2, and two pixels are 2 z / f apart.
    focal = min(visibility.camera.intrinsics[:2])
    return (farthest > 0) & (nearest - farthest <= inverse * np.float32(2 * MAX_SLOPE / focal))


def nearest_views(cameras: Sequence[Camera], target: Float[np.ndarray, "3"]) -> Int[np.ndarray, " n"]:
    """The camera with the most similar direction of view, for each camera.

    Args:
        cameras: Two cameras or more.
        target: Point that they look at, in world coordinates.

    Returns:
        Index of another camera for each camera.
    """
    directions = np.array([camera.centre for camera in cameras]) - target
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    cosines = directions @ directions.T
    np.fill_diagonal(cosines, -np.inf)
    return cosines.argmax(axis=1)
