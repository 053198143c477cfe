"""Sharpness: gradient energy of an image over that of a reference image. Blur lowers it below 1; noise raises it."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

import cv2
import numpy as np
from jaxtyping import Bool, Int, UInt8

from carigs.raster import compute_visibility
from evaluation.metrics.frame_views import FrameView
from evaluation.metrics.regions import MESH_REGIONS, SurfaceRegions, mesh_regions
from evaluation.tables.metric_records import MetricRecord, StudyPoint, metric_record


def gradient_energy(image: UInt8[np.ndarray, "h w 3"], region: Bool[np.ndarray, "h w"]) -> float:
    """Mean squared gradient by central differences.

    Args:
        image: Image.
        region: Pixels to average.

    Returns:
        Mean over pixels and channels of (dI/dx)^2 + (dI/dy)^2 per squared pixel, for values in [0, 1]; nan if the
        region is empty.
    """
    if not region.any():
        return float("nan")
    box = tuple(slice(max(i[0] - 1, 0), i[-1] + 2) for i in (np.flatnonzero(region.any(axis=a)) for a in (1, 0)))
    inside, mask, scale = image[box], region[box].astype(np.uint8), 0.5 / 255
    gradients = [cv2.Sobel(inside, cv2.CV_32F, *order, ksize=1, scale=scale) for order in ((1, 0), (0, 1))]
    return sum(float(np.mean(cv2.mean(cv2.multiply(g, g), mask)[:3])) for g in gradients)


def sharpness(
    image: UInt8[np.ndarray, "h w 3"],
    region: Bool[np.ndarray, "h w"],
    reference: UInt8[np.ndarray, "h w 3"],
    reference_region: Bool[np.ndarray, "h w"],
) -> float:
    """Ratio of the gradient energies of two images.

    Args:
        image: Rendered image.
        region: Pixels of the head in it, without its outline, whose gradient is that of the background.
        reference: Image to compare with.
        reference_region: Pixels of the head in it.

    Returns:
        The ratio; nan if a region is empty or the reference has no gradient.
    """
    energy = gradient_energy(reference, reference_region)
    return gradient_energy(image, region) / energy if energy > 0 else float("nan")


def sharpness_records(
    point: StudyPoint, view: FrameView, surface: SurfaceRegions, *, margin: int
) -> Iterator[MetricRecord]:
    """Compare the sharpness of a frame with that of its true image or, if there is none, of the captured frame.

    Args:
        point: Avatar and level.
        view: A frame of the capture's cameras.
        surface: Regions of the subject's surface.
        margin: Pixels along the outline of the mesh that are left out.

    Yields:
        By region, `sharpness` against the true image, which shows the same surface, or `sharpness_to_frame` against the
        frame, whose skin is not stretched by the exaggeration.
    """
    rendered, subject = view.rendered, view.head.subject
    record = partial(metric_record, point, rendered.protocol, (rendered.camera, rendered.timestep))
    regions = _interiors(surface, view.visibility.face, margin)
    if view.truth is not None:
        metric, reference, reference_regions = "sharpness", view.truth8, regions
    else:
        metric, reference = "sharpness_to_frame", subject.image8(view.frame)
        natural = compute_visibility(view.head.natural, subject.model.faces, view.camera)
        reference_regions = _interiors(surface, natural.face, margin)
    for region in MESH_REGIONS:
        if region not in regions:
            yield record(region, metric, None, surface.missing[region])
            continue
        value = sharpness(view.image8, regions[region], reference, reference_regions[region])
        reason = "no pixel of this region in view, or a reference without any gradient" if np.isnan(value) else ""
        yield record(region, metric, None if reason else value, reason)


def _interiors(
    surface: SurfaceRegions, face: Int[np.ndarray, "h w"], margin: int
) -> dict[str, Bool[np.ndarray, "h w"]]:
    """Regions of the mesh without the pixels near its outline."""
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * margin + 1, 2 * margin + 1))
    inner = cv2.erode((face >= 0).astype(np.uint8), disc) > 0
    return {name: region & inner for name, region in mesh_regions(surface, face).items()}
