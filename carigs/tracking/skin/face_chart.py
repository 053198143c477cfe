"""The face chart: a frontal image of the neutral face, whose pixels are points of the skin."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from carigs.capture import Camera, look_at
from carigs.head import HeadModel
from carigs.matting.channels import summed
from carigs.raster import compute_visibility

FACE, OTHER = ("face", "nose", "forehead"), ("left_eyeball", "right_eyeball", "boundary", "scalp")
"""Regions that the chart shows, and those that are left out of them: eyeballs turn by themselves."""
DISTANCE = 2.0
"""Metres from the chart's camera to the face."""
FILLED = 0.9
"""Share of the chart's longer side that the face fills."""
DEPTH_TOLERANCE = 0.004
"""Metres between a point of the skin and the surface that its pixel shows, up to which the pixel shows the point."""
LEAST_COSINE, FULL_COSINE = 0.2, 0.5
"""Cosine between normal and viewing direction from which a point counts at all, and counts fully."""
CONTRAST = 12 / 288
"""Standard deviation of the window in which contrast is made equal, in sides of the chart."""
DARK = 0.01
"""Added to the contrast of a window: less is noise."""
SMOOTHING = 3 / 288
"""Standard deviation of the smoothing of displacements before vertices take them, in sides of the chart."""


class UnwrappedFrame(NamedTuple):
    """The skin in a frame, in pixels of the chart."""

    image: Float32[np.ndarray, "s s"]
    """Grey values less their local mean, over their local standard deviation; 0 where the frame does not show skin."""
    weight: Float32[np.ndarray, "s s"]
    """How well the frame shows the point, from 0 to 1."""


@dataclass(frozen=True)
class FaceChart:
    """A frontal image of the neutral face."""

    corners: Int[np.ndarray, "s s 3"]
    """Vertices of the triangle at each pixel; any outside of the face."""
    barycentric: Float[np.ndarray, "s s 3"]
    """Their weights; 0 outside of the face."""
    faces: Int[np.ndarray, "f 3"]
    rest: Float[np.ndarray, "v 3"]
    """The neutral face in metres."""
    vertices: Int[np.ndarray, " n"]
    """Vertices that the chart shows."""
    places: Float32[np.ndarray, "n 2"]
    """Where it shows them, in pixels; the centre of the first pixel is at 0."""

    @property
    def inside(self) -> Bool[np.ndarray, "s s"]:
        """The pixels that show the face."""
        return self.barycentric[..., 0] + self.barycentric[..., 1] + self.barycentric[..., 2] > 0

    def lift(self, vertices: Float[np.ndarray, "v 3"]) -> Float[np.ndarray, "s s 3"]:
        """Points of a posed face at the pixels of the chart.

        Args:
            vertices: The face in metres.

        Returns:
            Points in metres; 0 outside of the face.
        """
        return sum(self.barycentric[..., i, None] * vertices[self.corners[..., i]] for i in range(3))

    def unwrap(
        self,
        image: UInt8[np.ndarray, "h w 3"],
        alpha: Float32[np.ndarray, "h w"],
        vertices: Float[np.ndarray, "v 3"],
        camera: Camera,
    ) -> UnwrappedFrame:
        """Take the skin of a frame into the chart.

        Args:
            image: The frame.
            alpha: Its matte.
            vertices: The posed head in world axes.
            camera: The camera.

        Returns:
            The skin.
        """
        seen, points = compute_visibility(vertices, self.faces, camera), self.lift(vertices)
        in_camera = camera.to_camera(points.reshape(-1, 3)).reshape(points.shape)
        depth = np.where(self.inside, in_camera[..., 2], 1.0)
        x, y = (
            (focal * in_camera[..., i] / depth + centre - 0.5).astype(np.float32)
            for i, (focal, centre) in enumerate(((camera.fx, camera.cx), (camera.fy, camera.cy)))
        )
        inverse, matte = (
            cv2.remap(values, x, y, cv2.INTER_LINEAR, borderValue=0.0) for values in (seen.inverse_depth, alpha)
        )
        grey = _sampled(summed(image.astype(np.float32), 1 / (3 * 255)), x, y, self.inside)
        first, second, third = (vertices[self.corners[..., i]] for i in range(3))
        normal, view = np.cross(second - first, third - first), camera.centre - points
        lengths = np.linalg.norm(normal, axis=2) * np.linalg.norm(view, axis=2)
        cosine = np.einsum("ijk,ijk->ij", normal, view) / np.maximum(lengths, 1e-12)
        in_front = self.inside & (np.abs(inverse * depth - 1) < DEPTH_TOLERANCE * np.maximum(inverse, 1e-6))
        facing = ((cosine - LEAST_COSINE) / (FULL_COSINE - LEAST_COSINE)).clip(0, 1)
        weight = cv2.erode((in_front * facing * (matte > 0.5)).astype(np.float32), np.ones((3, 3)))
        return UnwrappedFrame(_equalised(grey, weight), weight)

    def displacement(
        self, flow: Float32[np.ndarray, "s s 2"], weight: Float32[np.ndarray, "s s"]
    ) -> Float[np.ndarray, "n 3"]:
        """Displacement along the neutral face by which its points come to lie where a flow says.

        Args:
            flow: Where the point of each pixel is found, relative to the pixel, in pixels.
            weight: How much it counts.

        Returns:
            Metres, of `vertices`; 0 where no pixel beside the vertex counts.
        """
        place = np.stack(np.meshgrid(*map(np.arange, flow.shape[1::-1])), axis=-1).astype(np.float32) + flow
        x, y = np.ascontiguousarray(place[..., 0]), np.ascontiguousarray(place[..., 1])
        rest, inside = self.lift(self.rest).astype(np.float32), self.inside.astype(np.float32)
        # A point that comes from outside of the face has no displacement.
        counted = weight * inside * (cv2.remap(inside, x, y, cv2.INTER_LINEAR) > 0.99)
        moved = (cv2.remap(rest, x, y, cv2.INTER_LINEAR) - rest) * counted[..., None]
        sigma = SMOOTHING * len(flow)
        smooth = cv2.GaussianBlur(moved, (0, 0), sigma) / (cv2.GaussianBlur(counted, (0, 0), sigma) + 0.05)[..., None]
        return cv2.remap(smooth, self.places[:, None, 0], self.places[:, None, 1], cv2.INTER_LINEAR)[:, 0].astype(float)


def face_chart(model: HeadModel, rest: Float[np.ndarray, "v 3"], side: int) -> FaceChart | None:
    """Draw the chart of a face.

    Args:
        model: The head model.
        rest: The person's neutral head in metres, which looks along z.
        side: Pixels along each side.

    Returns:
        The chart; None if the model does not name the regions.
    """
    shown = np.zeros(len(rest), bool)
    shown[model.vertex_region(*FACE)] = True
    shown[model.vertex_region(*OTHER)] = False
    if not shown.any():
        return None
    low, high = rest[shown].min(axis=0), rest[shown].max(axis=0)
    centre = (low + high) / 2
    focal = FILLED * side * DISTANCE / (high - low)[:2].max()
    eye = centre + np.array([0, 0, DISTANCE])
    camera = Camera(look_at(eye, centre), focal, focal, side / 2, side / 2, side, side)
    faces = model.faces.astype(np.int64)
    seen = compute_visibility(rest, faces, camera)
    found = seen.fragments
    corners = faces[np.maximum(found.face, 0)]
    inside = (found.face >= 0) & shown[corners].all(axis=-1)
    depth, (x, y) = seen.camera_points[:, 2], (seen.pixels - 0.5).T
    column, row = np.rint(x).astype(int).clip(0, side - 1), np.rint(y).astype(int).clip(0, side - 1)
    inverse = seen.inverse_depth[row, column]
    frontal = shown & (np.abs(inverse * depth - 1) < DEPTH_TOLERANCE * inverse)
    vertices = np.flatnonzero(frontal)
    return FaceChart(
        corners,
        found.barycentric * inside[..., None],
        faces,
        rest,
        vertices,
        (seen.pixels[vertices] - 0.5).astype(np.float32),
    )


def _sampled(
    values: Float32[np.ndarray, "h w"],
    x: Float32[np.ndarray, "s s"],
    y: Float32[np.ndarray, "s s"],
    inside: Bool[np.ndarray, "s s"],
) -> Float32[np.ndarray, "s s"]:
    """Values at places of an image, which is made smaller first if it has many pixels for one of the chart."""
    beside = inside[:, 1:] & inside[:, :-1]
    step = np.median(np.hypot(np.diff(x), np.diff(y))[beside]) if beside.any() else 1.0
    if (factor := int(step)) > 1:
        values = cv2.resize(values, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA)
        x, y = ((place + 0.5) / factor - 0.5 for place in (x, y))
    return cv2.remap(values, x, y, cv2.INTER_LINEAR, borderValue=0.0)


def _equalised(grey: Float32[np.ndarray, "s s"], weight: Float32[np.ndarray, "s s"]) -> Float32[np.ndarray, "s s"]:
    """Grey values with equal local mean and contrast: light changes when a head turns."""
    sigma = CONTRAST * len(grey)
    total = cv2.GaussianBlur(weight, (0, 0), sigma) + 1e-4
    centred = grey - cv2.GaussianBlur(grey * weight, (0, 0), sigma) / total
    variance = cv2.GaussianBlur(centred**2 * weight, (0, 0), sigma) / total
    return (centred / (np.sqrt(variance) + DARK) * (weight > 0)).astype(np.float32)
