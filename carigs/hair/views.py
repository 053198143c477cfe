"""The frames that the hair of a capture is found in, at the resolution of strands."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from math import gcd
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int
from scipy.sparse.csgraph import minimum_spanning_tree

from carigs.capture import Camera, Capture, Frame
from carigs.capture.evenly_spread import evenly_spread
from carigs.errors import InputError
from carigs.head import pose
from carigs.mesh.rigid_alignment import rigid_alignment
from carigs.raster import Visibility, compute_visibility
from carigs.raster.open_mouth import between_lips

TIMESTEPS, CAMERAS = 9, 16
"""Most timesteps, and most cameras at each, evenly spread."""
WIDE = 45.0
"""Angle in degrees between neighbouring views, as the head sees them, from which on they count as far apart: what
lies between them is not seen, neither where hair ends nor how colours depend on the view."""
QUARTER = 4
"""Least stride of `some_views`."""
VIEWS = 36
"""Views for which more timesteps are read where there are few cameras: a head that turns shows more of its outline."""
MIN_DEPTH = 0.05
"""Metres from the camera to the middle of the head; nearer cameras are inside of it, or look away from it."""
PIXEL = 0.001
"""Size of a pixel on the head in metres: frames with smaller pixels are scaled down. Tufts of strands are about this
wide, and the textures of captures of different resolution can be compared."""


class HairView(NamedTuple):
    """A frame, and what its camera sees of the tracked mesh."""

    image: Float32[np.ndarray, "h w 3"]
    foreground: Float32[np.ndarray, "h w"]
    """Matte in [0, 1]."""
    visibility: Visibility
    between_lips: Bool[np.ndarray, "h w"]
    """Pixels of the open mouth, which are not looked at: teeth move against the mesh."""
    covering: Bool[np.ndarray, "h w"] | None = None
    """Pixels that semantic labels call hair, or something else that covers the head; None without labels."""


def read_views(
    capture: Capture,
    map_timesteps: Callable[..., Iterable] = map,
    read_labels: Callable[[Frame, tuple[int, int]], np.ndarray | None] | None = None,
) -> list[HairView]:
    """Read training frames of several timesteps and cameras.

    Args:
        capture: The capture.
        map_timesteps: `map`, or that of an executor; the result does not depend on it.
        read_labels: Returns the pixels of a frame, of a height and width, that labels call covering.

    Returns:
        The frames that can be read.
    """
    frames = capture.split("train")
    cameras = len({frame.camera for frame in frames})
    count = max(TIMESTEPS, VIEWS // max(cameras, 1))
    timesteps = evenly_spread(sorted({frame.timestep for frame in frames}), count)
    groups = [
        evenly_spread([frame for frame in frames if frame.timestep == timestep], CAMERAS) for timestep in timesteps
    ]
    return [view for views in map_timesteps(lambda group: _read(capture, group, read_labels), groups) for view in views]


def some_views(views: Sequence[HairView]) -> list[HairView]:
    """Take about a quarter of the views, of all cameras: neighbouring views see nearly the same.

    Args:
        views: The cameras of one timestep after the other, as `read_views` returns them.

    Returns:
        Every n-th view, where n has no factor in common with the number of cameras: otherwise the views would be those
        of a part of them.
    """
    cameras = len({view.visibility.camera.camera_from_world.tobytes() for view in views})
    stride = next(n for n in range(QUARTER, QUARTER + cameras + 1) if gcd(n, cameras) == 1)
    return list(views[::stride])


def largest_gap(directions: Float[np.ndarray, "n 3"]) -> float:
    """How far directions lie apart that have no others in between.

    Args:
        directions: Unit vectors.

    Returns:
        Degrees: the longest edge of the minimum spanning tree, whose removal divides the directions into two groups.
    """
    cosine = np.clip(directions @ directions.T, -1, 1)
    angle = np.degrees(np.arccos(cosine)) + 1e-9  # an edge of length 0 would be none
    return float(minimum_spanning_tree(angle).max()) if len(directions) > 1 else 0.0


def scalp_motion(
    canonical: Float[np.ndarray, "v 3"], seen: Visibility, carrier: Int[np.ndarray, " c"]
) -> Float[np.ndarray, "3 4"]:
    """Rotation and translation from the neutral head to camera axes that fit the scalp best.

    Args:
        canonical: Vertices of the neutral head in metres.
        seen: The camera's view of the posed head.
        carrier: Vertices of the scalp.

    Returns:
        Camera axes from the axes of the neutral head.
    """
    rotation, translation = rigid_alignment(canonical[carrier], seen.camera_points[carrier])
    return np.concatenate([rotation, translation[:, None]], axis=1)


def _read(capture: Capture, frames: list[Frame], read_labels: Callable | None) -> list[HairView]:
    """Views of the frames of one timestep."""
    vertices, views = pose(capture.model, capture.parameters(frames[0].timestep)), []
    for frame in frames:
        camera = capture.camera(frame)
        try:
            image, foreground = capture.image(frame), capture.foreground(frame)
        except InputError:
            continue  # the stage `gtstar` names it
        if image.shape[:2] != (camera.height, camera.width) or foreground.shape != image.shape[:2]:
            continue
        if not np.median(camera.to_camera(vertices)[:, 2]) > MIN_DEPTH:
            continue
        image, foreground, camera = _at_resolution(image, foreground, camera, vertices)
        seen = compute_visibility(vertices, capture.model.faces, camera)
        covering = None if read_labels is None else read_labels(frame, image.shape[:2])
        views.append(HairView(image, foreground, seen, between_lips(seen, capture.model), covering))
    return views


def _at_resolution(image: np.ndarray, foreground: np.ndarray, camera: Camera, vertices: np.ndarray):
    """Scale a frame down to pixels of `PIXEL`."""
    depth = float(np.median(camera.to_camera(vertices)[:, 2]))
    factor = depth / (PIXEL * float(np.sqrt(camera.fx * camera.fy)))
    if not factor < 0.8:  # slightly smaller pixels are left as they are
        return image, foreground, camera
    scaled = camera.scaled(factor)
    size = scaled.width, scaled.height
    return *(cv2.resize(each, size, interpolation=cv2.INTER_AREA) for each in (image, foreground)), scaled
