"""Exact mode: images of our rasteriser behind the page, small while something moves and full when it is still."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from jaxtyping import Float, Float32
from scipy.spatial.transform import Rotation

from carigs.capture import Camera
from carigs.splat.rasterizer.interface import WorldSurfels
from carigs.splat.rasterizer.rasterize import rasterize
from carigs.viewer.splat_records import SCENE_SCALE

BUDGET = 0.04
"""Seconds that an image may take while something moves."""
SMALLEST, LARGEST = 96, 1440
"""Heights of images in pixels."""
SMOOTHING = 0.5
"""Weight of the last image in the estimate of the time."""
DIVIDER, DIVIDER_WIDTH = (1.0, 0.45, 0.1), 2
"""Colour and width in pixels of the line between the halves of a split image."""


class View(NamedTuple):
    """Camera of a client as the browser reports it; y of the camera points down."""

    wxyz: tuple[float, float, float, float]
    """Rotation world_from_camera."""
    position: tuple[float, float, float]
    """Centre in units of the page."""
    fov: float
    """Angle from the top to the bottom of the image in radians."""
    width: int
    """Of the window in pixels."""
    height: int

    @property
    def is_possible(self) -> bool:
        """Whether there is such a camera: a hostile client may report anything."""
        try:
            numbers = [*map(float, self.wxyz), *map(float, self.position), float(self.fov)]
            sizes = [int(self.width), int(self.height)]
        except (TypeError, ValueError, OverflowError):
            return False
        if len(numbers) != 8 or not np.isfinite(numbers).all() or not np.abs(numbers).max() < 1e6:
            return False
        within = all(16 <= size <= 16384 for size in sizes) and 1 / 16 <= sizes[0] / sizes[1] <= 16
        return bool(within and 0.01 < numbers[7] < 3 and np.linalg.norm(numbers[:4]) > 1e-3)

    def camera(self, height: int | None = None) -> Camera:
        """The camera in metres.

        Args:
            height: Height of the image in pixels; None for that of the window.

        Returns:
            The camera; its image has the aspect of the window up to a pixel.
        """
        height = self.height if height is None else height
        width = max(round(height * self.width / self.height), 1)
        rotation = Rotation.from_quat(self.wxyz, scalar_first=True).as_matrix().T
        camera_from_world = np.eye(4)
        camera_from_world[:3, :3] = rotation
        camera_from_world[:3, 3] = -rotation @ (np.array(self.position, np.float64) / SCENE_SCALE)
        focal = 0.5 * height / float(np.tan(0.5 * self.fov))
        # The browser stretches the image to the window: a pixel of it is not always square.
        return Camera(
            camera_from_world,
            focal * width * self.height / (height * self.width),
            focal,
            width / 2,
            height / 2,
            width,
            height,
        )


def page_pose(camera: Camera) -> tuple[tuple[float, ...], tuple[float, ...], float]:
    """A camera as the page wants it.

    Args:
        camera: The camera, in metres.

    Returns:
        Rotation wxyz of world_from_camera, position in units of the page, and the angle from the top to the bottom of
        the image in radians.
    """
    wxyz = Rotation.from_matrix(camera.camera_from_world[:3, :3].T).as_quat(scalar_first=True)
    fov = 2 * np.arctan(0.5 * camera.height / camera.fy)
    return tuple(wxyz.tolist()), tuple((SCENE_SCALE * camera.centre).tolist()), float(fov)


def fitted(camera: Camera, width: int, height: int) -> Camera:
    """A camera of the capture whose image lies in the middle of an image of another shape, as large as possible.

    Args:
        camera: The camera.
        width: Width of the image in pixels.
        height: Height of the image.

    Returns:
        A camera of that size that sees the same and what is around it.
    """
    scale = min(width / camera.width, height / camera.height)
    left, top = 0.5 * (width - scale * camera.width), 0.5 * (height - scale * camera.height)
    intrinsics = scale * camera.fx, scale * camera.fy, scale * camera.cx + left, scale * camera.cy + top
    return Camera(camera.camera_from_world, *intrinsics, width, height)


def cropped(camera: Camera, first: int, last: int) -> Camera:
    """The part of a camera's image between two columns.

    Args:
        camera: The camera.
        first: First column.
        last: Column after the last one.

    Returns:
        The camera of these columns.
    """
    intrinsics = camera.fx, camera.fy, camera.cx - first, camera.cy
    return Camera(camera.camera_from_world, *intrinsics, last - first, camera.height)


def exact_image(surfels: WorldSurfels, camera: Camera, background: float) -> Float32[np.ndarray, "h w 3"]:
    """Render surfels as `PosedHead.render` does.

    Args:
        surfels: Surfels in world coordinates.
        camera: The view.
        background: Grey value behind the head.

    Returns:
        RGB in [0, 1].
    """
    with torch.no_grad():
        image = rasterize(surfels, camera, outputs=("colour",), background=background).colour
    return np.ascontiguousarray(image.numpy().clip(0, 1))


def split_image(
    left: Float32[np.ndarray, "h a 3"], right: Float32[np.ndarray, "h b 3"]
) -> Float32[np.ndarray, "h w 3"]:
    """Two parts of an image with a line between them.

    Args:
        left: The left part.
        right: The right part.

    Returns:
        RGB in [0, 1].
    """
    image = np.concatenate([left, right], axis=1)
    column = left.shape[1]
    if 0 < column < image.shape[1]:
        image[:, max(column - DIVIDER_WIDTH // 2, 0) : column + DIVIDER_WIDTH // 2] = DIVIDER
    return image


def pixels(image: Float[np.ndarray, "h w 3"]) -> np.ndarray:
    """An image in 8 bits.

    Args:
        image: RGB in [0, 1].

    Returns:
        RGB from 0 to 255.
    """
    return np.rint(255 * image).astype(np.uint8)


class Resolution:
    """Height of the image while something moves, from the time per pixel that the last images took."""

    def __init__(self, budget: float = BUDGET) -> None:
        """Start small.

        Args:
            budget: Seconds that an image may take.
        """
        self.budget = budget
        self._seconds_per_pixel: float | None = None

    def height(self, window: View) -> int:
        """Height of the next image.

        Args:
            window: The window.

        Returns:
            Height in pixels, at most that of the window.
        """
        largest = full_height(window)
        if self._seconds_per_pixel is None:
            return min(275, largest)
        height = int(np.sqrt(self.budget / self._seconds_per_pixel * window.height / window.width))
        return min(max(height, min(SMALLEST, largest)), largest)

    def measured(self, seconds: float, width: int, height: int) -> None:
        """Learn from an image.

        Args:
            seconds: Time that rendering and encoding took.
            width: Width of the image.
            height: Height of the image.
        """
        last = seconds / max(width * height, 1)
        old = last if self._seconds_per_pixel is None else self._seconds_per_pixel
        self._seconds_per_pixel = SMOOTHING * last + (1 - SMOOTHING) * old


def full_height(window: View) -> int:
    """Height of the image when nothing moves.

    Args:
        window: The window.

    Returns:
        Height in pixels: that of the window, at most `LARGEST`.
    """
    return min(int(window.height), LARGEST, int(LARGEST * 2 * window.height / window.width))
