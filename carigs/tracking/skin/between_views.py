"""Points of the skin that several cameras see at once: where one camera shows what another one shows.

Landmarks that a network finds in an image from the side lie a little beside those that it finds from the front, in all
frames alike. A head and cameras that were fitted to them alone disagreed by 2 to 4 pixels of frames 300 pixels high:
what one camera sees of the skin, laid on the head, did not lie where another camera sees it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, Int, UInt8

from carigs.capture import Camera
from carigs.footage import Footage
from carigs.head import HeadModel, HeadParameters, SurfacePoints, neutral, pose
from carigs.tracking.cameras import Cameras
from carigs.tracking.skin.face_chart import FaceChart, UnwrappedFrame, face_chart
from carigs.tracking.skin.groupwise_flow import flows_to_mean, warped

SPACING = 1 / 18
"""Between the points, in sides of the chart."""
WINDOW = 9 / 288
"""Standard deviation of the window in which views are compared, in sides of the chart."""
LEAST_AGREEMENT, LEAST_WEIGHT = 0.4, 0.2
"""Correlation of a view with the others, and weight of the pixel in it and in them, from which a point counts."""


@dataclass(frozen=True)
class SkinPoints:
    """Points of the skin in the images of c cameras at t timesteps."""

    points: SurfacePoints
    pixels: Float[np.ndarray, "t c m 2"]
    known: Float[np.ndarray, "t c m"]
    """From 0, where a camera does not show the point or no other one does, to 1."""


@dataclass(frozen=True)
class SimultaneousViews:
    """What several cameras recorded at the same times."""

    footages: Sequence[Footage]
    """Of each camera, with the same timesteps."""
    shown: Bool[np.ndarray, "t c"]
    """Which frames show the face."""

    def skin_points(
        self,
        model: HeadModel,
        parameters: Sequence[HeadParameters],
        found: Cameras,
        chosen: Int[np.ndarray, " m"],
        side: int,
    ) -> SkinPoints | None:
        """Find the same points of the skin in the images of several cameras.

        The face is unwrapped from each image onto one chart, and the charts of a timestep are moved onto their mean.
        By how much says where the cameras disagree, and not where a point of the head model is on the skin.

        Args:
            model: The head model.
            parameters: Those of each chosen timestep; all of one identity.
            found: The cameras.
            chosen: The timesteps, ascending.
            side: Pixels along the sides of the chart: few find large displacements, many find small ones exactly.

        Returns:
            The points; None if the model does not name the regions of a face.
        """
        chart = face_chart(model, neutral(model, parameters[0]), side)
        if chart is None:
            return None
        cameras = found.pinholes([(footage.width, footage.height) for footage in self.footages])
        row, column = _lattice(chart)
        points = SurfacePoints(chart.corners[row, column], chart.barycentric[row, column])
        pixels = np.zeros((len(chosen), len(cameras), len(points), 2))
        known = np.zeros(pixels.shape[:3])
        for t, (frame, views) in enumerate(zip(parameters, self._images(chosen), strict=True)):
            if len(views) < 2:
                continue
            posed = pose(model, frame)
            charts = [
                chart.unwrap(image, np.ones(image.shape[:2], np.float32), posed, cameras[c])
                for c, image in views.items()
            ]
            flows, counts = _matched(charts)
            lifted = chart.lift(posed)
            for c, flow, count in zip(views, flows, counts, strict=True):
                pixels[t, c], inside = _seen(chart, lifted, cameras[c], flow[row, column], row, column)
                known[t, c] = count[row, column] * inside
        return SkinPoints(points, pixels, known)

    def _images(self, chosen: Int[np.ndarray, " m"]) -> Iterator[dict[int, UInt8[np.ndarray, "h w 3"]]]:
        """Of each chosen timestep, the images of the cameras that show the face."""
        rows = zip(*(footage.at(chosen).decode() for footage in self.footages), strict=True)
        for t, row in zip(chosen, rows, strict=True):
            yield {c: image for c, image in enumerate(row) if self.shown[t, c]}


def _lattice(chart: FaceChart) -> tuple[Int[np.ndarray, " m"], Int[np.ndarray, " m"]]:
    """Rows and columns of points of the face that are evenly spread over the chart."""
    inside = chart.inside
    step = SPACING * len(inside)
    places = np.rint(np.arange(step / 2, len(inside) - 1, step)).astype(int)
    row, column = (axis.ravel() for axis in np.meshgrid(places, places, indexing="ij"))
    found = inside[row, column]
    return row[found], column[found]


def _matched(
    views: Sequence[UnwrappedFrame],
) -> tuple[Float32[np.ndarray, "k s s 2"], Float32[np.ndarray, "k s s"]]:
    """Flows of the views to their mean, and how far each of them agrees there with the others, from 0 to 1."""
    side = len(views[0].image)
    grid = np.stack(np.meshgrid(np.arange(side), np.arange(side)), axis=-1).astype(np.float32)
    flows = flows_to_mean(views)
    moved = [warped(view, grid + flow) for view, flow in zip(views, flows, strict=True)]
    total, summed = sum(view.weight for view in moved), sum(view.weight * view.image for view in moved)
    counts = []
    for view in moved:
        rest = total - view.weight
        others = UnwrappedFrame((summed - view.weight * view.image) / np.maximum(rest, 1e-3), np.minimum(rest, 1))
        weight = view.weight * others.weight
        agreement = _correlation(view, others, WINDOW * side)
        counts.append(weight * agreement * (agreement > LEAST_AGREEMENT) * (weight > LEAST_WEIGHT))
    return flows, np.stack(counts)


def _correlation(one: UnwrappedFrame, other: UnwrappedFrame, sigma: float) -> Float32[np.ndarray, "s s"]:
    """Correlation of two images in Gaussian windows, where both have values."""
    weight = np.minimum(one.weight, other.weight)
    total = cv2.GaussianBlur(weight, (0, 0), sigma) + 1e-4

    def mean(values: Float32[np.ndarray, "s s"]) -> Float32[np.ndarray, "s s"]:
        return cv2.GaussianBlur(weight * values, (0, 0), sigma) / total

    first, second = mean(one.image), mean(other.image)
    variances = (mean(one.image**2) - first**2) * (mean(other.image**2) - second**2)
    return ((mean(one.image * other.image) - first * second) / np.sqrt(np.maximum(variances, 1e-8))).clip(0, 1)


def _seen(
    chart: FaceChart,
    lifted: Float[np.ndarray, "s s 3"],
    camera: Camera,
    flow: Float32[np.ndarray, "m 2"],
    row: Int[np.ndarray, " m"],
    column: Int[np.ndarray, " m"],
) -> tuple[Float[np.ndarray, "m 2"], Bool[np.ndarray, " m"]]:
    """Where a camera shows points of the mean, in pixels, and whether that lies in the face."""
    x, y = (column + flow[:, 0]).astype(np.float32)[:, None], (row + flow[:, 1]).astype(np.float32)[:, None]

    def sampled(values: Float[np.ndarray, "s s ..."]) -> Float32[np.ndarray, "m ..."]:
        return cv2.remap(values.astype(np.float32), x, y, cv2.INTER_LINEAR, borderValue=0.0)[:, 0]

    inside = sampled(chart.inside) > 0.99
    pixels, depth = camera.project(sampled(lifted).astype(np.float64))
    return np.where(inside[:, None], pixels, 0), inside & (depth > 0)
