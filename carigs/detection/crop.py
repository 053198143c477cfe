"""Rotated squares of an image: what a network is shown, and the way back from its pixels to those of the image."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, UInt8

WARP_LIMIT = 30_000
"""Width and height of an image that `cv2.warpAffine` takes: its coordinates have 16 bits."""


class Crop(NamedTuple):
    """A rotated square of an image."""

    x: float
    """Its centre in pixels of the image; pixel centres at +0.5, as everywhere."""
    y: float
    size: float
    """Length of a side in pixels of the image."""
    angle: float
    """Direction of its upper side in radians, from the x axis of the image towards its y axis."""

    def scaled(self, factor: float) -> Crop:
        """The square with another size around the same centre.

        Args:
            factor: Its size in sizes of this one.

        Returns:
            The square.
        """
        return self._replace(size=self.size * factor)


def image_from_crop(crop: Crop, side: int) -> Float[np.ndarray, "2 3"]:
    """The similarity from pixels of a crop to pixels of the image.

    Args:
        crop: The crop.
        side: Width and height of the crop in its own pixels.

    Returns:
        Affine matrix for points with pixel centres at +0.5, in both.
    """
    scale = crop.size / side
    cos, sin = scale * math.cos(crop.angle), scale * math.sin(crop.angle)
    linear = np.array([[cos, -sin], [sin, cos]])
    return np.column_stack([linear, (crop.x, crop.y) - linear @ (side / 2, side / 2)])


def to_image(points: Float[np.ndarray, "p 3"], crop: Crop, side: int) -> Float[np.ndarray, "p 3"]:
    """Move points of a crop to the image.

    Args:
        points: x, y in pixels of the crop, and z in the same unit.
        crop: The crop.
        side: Width and height of the crop in its own pixels.

    Returns:
        x, y, z in pixels of the image.
    """
    matrix = image_from_crop(crop, side)
    moved = points[:, :2] @ matrix[:, :2].T + matrix[:, 2]
    return np.column_stack([moved, points[:, 2] * (crop.size / side)])


def sample(
    image: UInt8[np.ndarray, "h w 3"], crop: Crop, side: int, border: int = cv2.BORDER_REPLICATE
) -> UInt8[np.ndarray, "side side 3"]:
    """Sample a crop bilinearly.

    Where a pixel of the crop covers several of the image, these are averaged before: the noise of the landmarks would
    else be that of few pixels.

    Args:
        image: The image.
        crop: The crop; it may reach beyond the image.
        side: Width and height of the result.
        border: What lies beyond the image, one of OpenCV's constants: the pixels of its edge, or black.

    Returns:
        The pixels.
    """
    matrix = image_from_crop(crop, side)
    height, width = image.shape[:2]
    reach = crop.size * (abs(math.cos(crop.angle)) + abs(math.sin(crop.angle))) / 2 + 2
    left, right = _window(crop.x, reach, width)
    top, bottom = _window(crop.y, reach, height)
    part = image[top:bottom, left:right]
    matrix[:, 2] -= (left, top)
    factor = np.array([1.0, 1.0])
    smaller = [max(1, int(length * side // crop.size)) for length in (part.shape[1], part.shape[0])]
    if crop.size >= 2 * side or max(part.shape[:2]) > WARP_LIMIT:
        factor = np.array([smaller[0] / part.shape[1], smaller[1] / part.shape[0]])
        part = cv2.resize(part, smaller, interpolation=cv2.INTER_AREA)
    matrix *= factor[:, None]
    matrix[:, 2] += matrix[:, :2] @ (0.5, 0.5) - 0.5  # OpenCV has pixel centres at whole numbers
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return cv2.warpAffine(part, matrix, (side, side), flags=flags, borderMode=border)


def _window(centre: float, reach: float, length: int) -> tuple[int, int]:
    """Rows or columns of the image that a crop touches, at least one."""
    first = min(max(math.floor(centre - reach), 0), length - 1)
    return first, max(min(math.ceil(centre + reach), length), first + 1)


def around(box: Float[np.ndarray, "4"], left: Float[np.ndarray, "2"], right: Float[np.ndarray, "2"]) -> Crop:
    """The square around an upright box, turned so that a line becomes horizontal.

    Args:
        box: Left, top, right, bottom in pixels.
        left: Start of the line.
        right: Its end.

    Returns:
        A square with the longer side of the box.
    """
    centre = (box[:2] + box[2:]) / 2
    direction = right - left
    size = max(box[2] - box[0], box[3] - box[1])
    return Crop(float(centre[0]), float(centre[1]), float(size), math.atan2(direction[1], direction[0]))


def turned_around(
    points: Float[np.ndarray, "p 2"], left: Float[np.ndarray, "2"], right: Float[np.ndarray, "2"]
) -> Crop:
    """The square around the box of points whose sides are parallel to a line.

    Args:
        points: Points in pixels.
        left: Start of the line.
        right: Its end.

    Returns:
        A square with the longer side of that box. A turned image gives the turned square.
    """
    direction = right - left
    angle = math.atan2(direction[1], direction[0])
    cos, sin = math.cos(angle), math.sin(angle)
    image_from_upright = np.array([[cos, -sin], [sin, cos]])
    upright = points @ image_from_upright
    low, high = upright.min(axis=0), upright.max(axis=0)
    centre = image_from_upright @ (low + high) / 2
    return Crop(float(centre[0]), float(centre[1]), float((high - low).max()), angle)
