"""PSNR, SSIM and LPIPS of a rendered frame against the true image of the same frame, by region."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from evaluation.metrics.frame_views import FrameView
from evaluation.metrics.image_quality import IMAGE_METRICS
from evaluation.metrics.lpips import LPIPS_METRICS, LPIPS_REGIONS, SMALLEST_IMAGE, lpips
from evaluation.metrics.regions import SurfaceRegions, image_regions
from evaluation.tables.metric_records import REGIONS, MetricRecord, StudyPoint, metric_record

if TYPE_CHECKING:
    import torch


def truth_records(
    point: StudyPoint,
    view: FrameView,
    surface: SurfaceRegions,
    networks: Mapping[str, torch.nn.Module],
    *,
    band: int,
) -> Iterator[MetricRecord]:
    """Compare a frame with its true image.

    Args:
        point: Avatar and level.
        view: A frame of the capture's cameras.
        surface: Regions of the subject's surface.
        networks: Network of each variant of LPIPS (`evaluation.metrics.lpips.load_lpips_metrics`).
        band: Half width of the silhouette region in pixels.

    Yields:
        One record per region and metric; without a value where there is no truth or no pixel of the region.

    Raises:
        InputError: An image has another size than its camera.
    """
    frame = view.rendered
    record = partial(metric_record, point, frame.protocol, (frame.camera, frame.timestep))
    if view.truth is None:
        for metric in (*IMAGE_METRICS, *networks):
            yield record("full", metric, None, "no true image of this frame")
        return
    image, truth = (values.astype(np.float32) / 255 for values in (view.image8, view.truth8))
    regions = image_regions(
        surface, view.head.vertices, view.visibility.fragments, view.camera, view.foreground, band=band
    )
    size = view.camera.height * view.camera.width
    maps = {name: metric.pixel_map(image, truth).reshape(size, -1) for name, metric in IMAGE_METRICS.items()}
    for region in REGIONS:
        if region not in regions:
            inside, reason = None, surface.missing[region]
        else:
            inside = np.flatnonzero(regions[region])
            reason = "" if inside.size else "no pixel of this region in view"
        for name, metric in IMAGE_METRICS.items():
            yield record(region, name, None if reason else metric.summarise(maps[name][inside]), reason)
    for name, network in networks.items():
        distances, reason = {}, f"images of less than {SMALLEST_IMAGE} pixels have no LPIPS"
        if min(view.camera.height, view.camera.width) >= SMALLEST_IMAGE:
            inside = {region: regions[region] for region in LPIPS_REGIONS}
            distances = lpips(network, image, truth, inside, normalize=LPIPS_METRICS[name].normalize)
            reason = ""
        for region in LPIPS_REGIONS:
            yield record(region, name, distances.get(region), reason)
