"""How shoulders and chest move in footage, from the images themselves: they have no landmarks.

The pixels below the neck's border in one frame are points in a plane that faces the camera. A rigid motion of these
points is found for every other frame such that the frame has their colours and opacities there: direct alignment by
Gauss-Newton (Lucas and Kanade 1981, forward additive), from blurred images to sharper ones. The outline counts, too,
because the background is transparent: it shows how a plain shirt moves.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8
from scipy.spatial.transform import Rotation

from carigs.capture import Camera
from carigs.raster import rasterize_mesh

PIXEL = 0.003
"""Size of a pixel at the head in metres: larger images are scaled down."""
BLURS = (4.0, 1.5)
"""Standard deviations in pixels of the blur of images, one after the other."""
ITERATIONS = 8
HEAD_MARGIN, OUTSIDE = 2, 4
"""Pixels around the head that are not looked at, and pixels of background around the torso that are."""
OPAQUE = 127
"""Opacity from which on a pixel shows the person."""
ABOVE = 0.03
"""Metres above the border of the neck up to which pixels belong to the torso."""
LEAST_PIXELS = 300
"""Of a torso, 27 square centimetres, in the image of a camera."""
OUTLIER = 0.15
"""Difference of colours or opacities from which on pixels count little (Geman and McClure)."""
ROTATION, TRANSLATION = 0.1, 0.05
"""Standard deviations of the motion in radians and metres: a plane does not show well how it turns."""
NOISE, INDEPENDENT = 0.03, 0.02
"""Standard deviation of a difference, and share of them that are independent of the others."""
CONVERGED = 1e-4
"""Largest change of a step in radians and metres."""


class TorsoView(NamedTuple):
    """A frame, scaled down."""

    camera: Camera
    image: UInt8[np.ndarray, "h w 4"]
    """Colours times opacity, and opacity."""
    head: Bool[np.ndarray, "h w"]
    """The head and pixels around it."""


def torso_view(
    image: Float32[np.ndarray, "h w 3"] | UInt8[np.ndarray, "h w 3"],
    alpha: Float32[np.ndarray, "h w"],
    posed: Float[np.ndarray, "v 3"],
    faces: Int[np.ndarray, "f 3"],
    camera: Camera,
) -> TorsoView:
    """Scale a frame down, and find the head in it.

    Args:
        image: Colours without the background that shows through, from 0 to 255.
        alpha: Opacity of the person.
        posed: Vertices of the head in metres.
        faces: Vertex indices of its triangles.
        camera: The camera.

    Returns:
        The frame.
    """
    rgba = np.dstack([image * alpha[..., None], 255 * alpha]).astype(np.float32)
    depth = max(float(np.median(camera.to_camera(posed)[:, 2])), 1e-3)
    factor = depth / (PIXEL * float(np.sqrt(camera.fx * camera.fy)))
    if factor < 1:
        camera = camera.scaled(factor)
        rgba = cv2.resize(rgba, (camera.width, camera.height), interpolation=cv2.INTER_AREA)
    head = (rasterize_mesh(posed, faces, camera).face >= 0).astype(np.uint8)
    return TorsoView(camera, np.rint(rgba).clip(0, 255).astype(np.uint8), _dilated(head, HEAD_MARGIN) > 0)


def torso_motion(
    views: Sequence[Sequence[TorsoView]], reference: int, border: Float[np.ndarray, "b 3"], up: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "t 4 4"] | None:
    """Find how the torso moves from one frame to each other one.

    Args:
        views: Those of each timestep, one of each camera.
        reference: The timestep that the others are compared with.
        border: Vertices of the neck's border in this timestep, in metres.
        up: Unit vector along the neck, towards the head, in this timestep.

    Returns:
        Rigid motions in world axes from the reference to each timestep; None if too little of a torso is seen.
    """
    centre = border.mean(axis=0)
    seen = [_torso_pixels(view, centre, up) for view in views[reference]]
    opaque = [pixels & (view.image[..., 3] > OPAQUE) for pixels, view in zip(seen, views[reference], strict=True)]
    if not max((int(pixels.sum()) for pixels in opaque), default=0) >= LEAST_PIXELS:
        return None
    points = [_in_plane(view.camera, pixels, centre) for view, pixels in zip(views[reference], seen, strict=True)]
    wanted = [
        [_blurred(view, sigma)[pixels] for view, pixels in zip(views[reference], seen, strict=True)] for sigma in BLURS
    ]
    motions = np.zeros((len(views), 6))
    for order in (range(reference + 1, len(views)), range(reference - 1, -1, -1)):
        motion = np.zeros(6)
        for t in order:
            for sigma, colours in zip(BLURS, wanted, strict=True):
                motion = _aligned(motion, views[t], points, colours, sigma, centre)
            motions[t] = motion
    matrices = np.tile(np.eye(4), (len(views), 1, 1))
    matrices[:, :3, :3] = Rotation.from_rotvec(motions[:, :3]).as_matrix()
    matrices[:, :3, 3] = centre + motions[:, 3:] - matrices[:, :3, :3] @ centre
    return matrices


def _torso_pixels(
    view: TorsoView, centre: Float[np.ndarray, "3"], up: Float[np.ndarray, "3"]
) -> Bool[np.ndarray, "h w"]:
    """Pixels of the torso and of the background around it."""
    person = _dilated((view.image[..., 3] > OPAQUE).astype(np.uint8), OUTSIDE) > 0
    every = np.ones(person.shape, bool)
    height = (_in_plane(view.camera, every, centre) - centre) @ up
    return person & ~view.head & (height < ABOVE).reshape(person.shape)


def _in_plane(
    camera: Camera, pixels: Bool[np.ndarray, "h w"], centre: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "n 3"]:
    """Points that pixels show in the plane through a point that faces the camera."""
    depth = float(camera.to_camera(centre[None])[0, 2])
    row, column = np.nonzero(pixels)
    x, y = (column + 0.5 - camera.cx) / camera.fx, (row + 0.5 - camera.cy) / camera.fy
    placed = depth * np.stack([x, y, np.ones(len(x))], axis=1)
    matrix = camera.camera_from_world
    return (placed - matrix[:3, 3]) @ matrix[:3, :3]


def _aligned(
    motion: Float[np.ndarray, "6"],
    views: Sequence[TorsoView],
    points: Sequence[Float[np.ndarray, "n 3"]],
    colours: Sequence[Float32[np.ndarray, "n 4"]],
    sigma: float,
    centre: Float[np.ndarray, "3"],
) -> Float[np.ndarray, "6"]:
    """Refine a motion, a rotation vector about the centre and a translation, by the images of a timestep."""
    images = [_blurred(view, sigma) for view in views]
    slopes = [[cv2.Sobel(image, cv2.CV_32F, *axis, scale=1 / 8) for axis in ((1, 0), (0, 1))] for image in images]
    prior = NOISE**2 / INDEPENDENT / np.repeat([ROTATION, TRANSLATION], 3) ** 2
    for _ in range(ITERATIONS):
        matrix, vector = np.diag(prior), prior * motion
        rotation = Rotation.from_rotvec(motion[:3])
        for view, image, slope, rest, wanted in zip(views, images, slopes, points, colours, strict=True):
            arm = rotation.apply(rest - centre)
            x, y, depth, moved = _projected(view.camera, arm + centre + motion[3:], arm)
            inside = (x >= 0) & (y >= 0) & (x <= view.camera.width - 1) & (y <= view.camera.height - 1)
            inside[inside] &= ~view.head[np.rint(y[inside]).astype(int), np.rint(x[inside]).astype(int)]
            inside &= depth > 0
            found, *along = (_sampled(each, x[inside], y[inside]) for each in (image, *slope))
            difference = found - wanted[inside]
            weight = 1 / (1 + (difference / OUTLIER) ** 2) ** 2
            jacobian = sum(g[..., None] * each[inside][:, None] for g, each in zip(along, moved, strict=True))
            matrix += np.einsum("nc,nci,ncj->ij", weight, jacobian, jacobian)
            vector += np.einsum("nc,nci,nc->i", weight, jacobian, difference)
        step = -np.linalg.solve(matrix, vector)
        motion = np.concatenate([(Rotation.from_rotvec(step[:3]) * rotation).as_rotvec(), motion[3:] + step[3:]])
        if np.abs(step).max() < CONVERGED:
            break
    return motion


def _projected(camera: Camera, points: Float[np.ndarray, "n 3"], arm: Float[np.ndarray, "n 3"]):
    """Columns and rows of pixel centres, depths, and how columns and rows change as points turn and shift."""
    x, y, depth = camera.to_camera(points).T
    depth_or_one = np.where(depth > 0, depth, 1)
    axes = camera.camera_from_world[:3, :3]
    moved = []
    for focal, place, axis in ((camera.fx, x, axes[0]), (camera.fy, y, axes[1])):
        shift = (focal / depth_or_one)[:, None] * (axis - (place / depth_or_one)[:, None] * axes[2])
        moved.append(np.hstack([np.cross(arm, shift), shift]))
    column, row = camera.fx * x / depth_or_one + camera.cx - 0.5, camera.fy * y / depth_or_one + camera.cy - 0.5
    return column, row, depth, moved


def _blurred(view: TorsoView, sigma: float) -> Float32[np.ndarray, "h w 4"]:
    return cv2.GaussianBlur(view.image.astype(np.float32) / 255, (0, 0), sigma)


def _sampled(image: Float32[np.ndarray, "h w 4"], x: np.ndarray, y: np.ndarray) -> Float32[np.ndarray, "n 4"]:
    """Bilinear interpolation, in parts: OpenCV's images have fewer than 32768 rows."""
    columns, rows = (np.resize(each, (-(-len(x) // 4096), 4096)).astype(np.float32) for each in (x, y))
    return cv2.remap(image, columns, rows, cv2.INTER_LINEAR).reshape(-1, 4)[: len(x)]


def _dilated(mask: UInt8[np.ndarray, "h w"], radius: int) -> UInt8[np.ndarray, "h w"]:
    return cv2.dilate(mask, np.ones((2 * radius + 1, 2 * radius + 1), np.uint8))
