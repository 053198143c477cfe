"""Cameras around the head of an avatar."""

from __future__ import annotations

import numpy as np

from carigs.capture import Camera, look_at
from carigs.errors import SettingsError
from carigs.library.head_avatar import HeadAvatar

MARGIN = 1.35
"""Height of the image over that of the head, at the distance of its middle."""
FIELD_OF_VIEW = 22.0
"""Degrees from the top to the bottom of the image: a portrait lens."""


def orbit(
    avatar: HeadAvatar,
    count: int = 36,
    *,
    degrees: float = 360.0,
    azimuth: float = 0.0,
    elevation: float = 0.0,
    size: int | tuple[int, int] = 512,
    distance: float | None = None,
) -> list[Camera]:
    """Place cameras on a horizontal circle around the head.

    Args:
        avatar: The avatar.
        count: Number of cameras.
        degrees: Angle of the arc that they stand on; 360 for the whole circle, whose end is not repeated.
        azimuth: Degrees from the front of the face to the middle of the arc, towards the left of the head.
        elevation: Degrees above the horizon.
        size: Height and width of the images in pixels, or one number for both.
        distance: From the middle of the head, in metres; None fits the head into the image.

    Returns:
        The cameras.

    Raises:
        SettingsError: If the count, the size or the distance is not positive, an angle is not finite, or the elevation
            is not between -90 and 90 degrees.

    Example:
        >>> import carigs
        >>> avatar = carigs.load("avatar.npz")  # doctest: +SKIP
        >>> images = [avatar.render(camera, level=0.2) for camera in carigs.orbit(avatar, 8)]  # doctest: +SKIP
    """
    height, width = (size, size) if isinstance(size, int) else size
    if count < 1 or height < 1 or width < 1 or not (distance is None or 0 < distance < np.inf):
        raise SettingsError(f"orbit: count={count}, size={size}, distance={distance}: they must be positive")
    if not (abs(elevation) < 90 and np.isfinite([degrees, azimuth]).all()):  # from above, no direction is up
        raise SettingsError(
            f"orbit: degrees={degrees}, azimuth={azimuth}, elevation={elevation}: "
            "expected angles, and an elevation between -90 and 90"
        )
    vertices = avatar.pose().vertices
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    middle, extent = 0.5 * (low + high), float((high - low).max())
    tangent = np.tan(np.radians(FIELD_OF_VIEW / 2))
    focal = 0.5 * height / tangent
    if distance is None:
        distance = 0.5 * MARGIN * extent / (tangent * min(1.0, width / height))
    last = degrees * (1 - 1 / count) if abs(degrees) >= 360 else degrees
    azimuths = np.radians(azimuth + (np.linspace(-last / 2, last / 2, count) if count > 1 else np.zeros(1)))
    up, out = np.sin(np.radians(elevation)), np.cos(np.radians(elevation))
    cameras = []
    for angle in azimuths:
        centre = middle + distance * np.array([out * np.sin(angle), up, out * np.cos(angle)])
        cameras.append(Camera(look_at(centre, middle), focal, focal, width / 2, height / 2, width, height))
    return cameras
