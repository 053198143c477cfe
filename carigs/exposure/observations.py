"""What the cameras of a capture show at vertices of the posed head: colours, fine detail, and where in the image."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float64, Int, UInt8

from carigs.capture import Camera, Capture, Frame
from carigs.capture.corrections.colour_gains import TOE
from carigs.capture.evenly_spread import evenly_spread
from carigs.capture.thinning import spread_timesteps
from carigs.errors import InputError
from carigs.head import pose
from carigs.mesh.triangle_mesh import vertex_normals
from carigs.raster import compute_visibility
from carigs.raster.vertex_colours import sample_colours, visible_vertices

VIEWS = 256
"""Frames that are looked at, all of a smaller capture: two seconds for images of 401 x 275."""
VERTICES = 1500
"""Vertices, evenly spread."""
PATCHES = 12
"""Parts of the head. More of them are not independent: with 80, errors come out at half of what they are."""
DARKEST, BRIGHTEST = 0.06, 0.97
"""sRGB values between which no channel is clipped, nor mostly noise."""
INSIDE = 3
"""Width in pixels of the neighbourhood that lies in the matte: at its edge, pixels mix with the background."""
DETAIL_WIDTH = 7
"""Width in pixels of the neighbourhood over which fine detail is averaged."""
SCALED = 0.8
"""Images are scaled down for fine detail if their pixels are finer than this times the coarsest camera's."""
DETAIL_FLOOR = 1.0
"""Levels of 255 added to fine detail: below, there is only the noise of 8 bits."""


class Observations(NamedTuple):
    """What c cameras show at v vertices at t timesteps; NaN where a vertex is hidden, or the frame is missing."""

    cameras: list[int]
    timesteps: list[int]
    colour: Float64[np.ndarray, "c t v 3"]
    """Logarithms of sRGB values + `TOE`: a factor on linear light adds the same number to all of them."""
    detail: Float64[np.ndarray, "c t v 1"]
    """Logarithms of the root mean square of the Laplacian around, in levels of 255, in pixels of one size."""
    row: Float64[np.ndarray, "c t v"]
    """Where in the image: 0 at its top, 1 at its bottom."""
    normal: Float64[np.ndarray, "t v 3"]
    """Unit normals in world axes."""
    patch: Int[np.ndarray, " v"]
    """Part of the head, from 0 to `PATCHES` - 1."""


def observe(capture: Capture, frames: Sequence[Frame]) -> Observations:
    """Look at the vertices of the head in some frames.

    Args:
        capture: The capture.
        frames: Frames that may be looked at: all at `VIEWS` or fewer, else those at evenly spread timesteps. Frames
            that cannot be read are left out: other checks name them.

    Returns:
        What they show.
    """
    model, cameras = capture.model, sorted({frame.camera for frame in frames})
    timesteps = spread_timesteps(frames, VIEWS)
    some = np.array(evenly_spread(range(len(model.v_template)), VERTICES))
    shape = len(cameras), len(timesteps), len(some)
    colour, detail, row = np.full((*shape, 3), np.nan), np.full((*shape, 1), np.nan), np.full(shape, np.nan)
    normal, coarsest = np.zeros((*shape[1:], 3)), 0.0
    groups: dict[int, list[Frame]] = {timestep: [] for timestep in timesteps}
    for frame in frames:
        if frame.timestep in groups:
            groups[frame.timestep].append(frame)
    for t, group in enumerate(groups.values()):
        vertices = pose(model, capture.parameters(group[0].timestep))
        normals = vertex_normals(vertices, model.faces)
        normal[t] = normals[some]
        coarsest = coarsest or max(_pixel_size(capture.camera(frame), vertices) for frame in group)
        for frame in group:
            try:
                image, foreground = capture.image8(frame), capture.foreground(frame)
            except InputError:
                continue
            camera, c = capture.camera(frame), cameras.index(frame.camera)
            seen = visible_vertices(compute_visibility(vertices, model.faces, camera), vertices, normals)
            used = np.isin(seen.index, some)
            pixels = seen.pixels[used]
            at = np.searchsorted(some, seen.index[used])
            x, y = pixels.astype(int).T
            inside = cv2.erode(foreground, np.ones((INSIDE, INSIDE), np.uint8))[y, x] >= 1
            rgb, _ = sample_colours(image.astype(np.float32) / 255, pixels)
            exposed = inside & (rgb.min(axis=1) > DARKEST) & (rgb.max(axis=1) < BRIGHTEST)
            colour[c, t, at[exposed]] = np.log(rgb[exposed] + TOE)
            factor = min(_pixel_size(camera, vertices) / coarsest, 1.0)
            detail[c, t, at[inside], 0] = np.log(_detail(image, factor, pixels[inside]) + DETAIL_FLOOR)
            row[c, t, at] = pixels[:, 1] / camera.height
    return Observations(cameras, timesteps, colour, detail, row, normal, head_patches(model.v_template[some]))


def _pixel_size(camera: Camera, vertices: Float[np.ndarray, "v 3"]) -> float:
    """Metres that a pixel covers at the distance of the head."""
    depth = max(float(np.median(camera.to_camera(vertices)[:, 2])), 1e-3)
    return depth / float(np.sqrt(camera.fx * camera.fy))


def _detail(
    image: UInt8[np.ndarray, "h w 3"], factor: float, pixels: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, " n"]:
    """Root mean square of the Laplacian of the brightness around some pixels of an image that is scaled down."""
    grey = cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    if factor < SCALED:
        grey = cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_AREA)
    height, width = grey.shape
    y, x = (pixels[:, ::-1] * [height / image.shape[0], width / image.shape[1]]).astype(int).T
    laplacian = cv2.Laplacian(grey, cv2.CV_32F)
    return np.sqrt(cv2.blur(laplacian**2, (DETAIL_WIDTH, DETAIL_WIDTH)))[y, x]


def head_patches(points: Float[np.ndarray, "v 3"], count: int = PATCHES) -> Int[np.ndarray, " v"]:
    """Divide points into parts of similar size, by the nearest of points that lie far apart (Gonzalez 1985).

    Args:
        points: The points.
        count: Number of parts.

    Returns:
        The part of each point.
    """
    nearest, patch = np.full(len(points), np.inf), np.zeros(len(points), np.int64)
    centre = points.mean(axis=0)
    for k in range(min(count, len(points))):
        distance = ((points - centre) ** 2).sum(axis=1)
        if k == 0:  # the first lies farthest from the middle
            distance = ((points - points[distance.argmax()]) ** 2).sum(axis=1)
        closer = distance < nearest
        patch[closer], nearest = k, np.minimum(nearest, distance)
        centre = points[nearest.argmax()]
    return patch
