"""PSNR and SSIM of rendered frames against the true images of the same frames, by region."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from itertools import product

import numpy as np
from rich.progress import track

from carigs.capture import Capture
from carigs.capture.frame_index import GroundTruth, RenderedImage
from carigs.capture.images import read_grey, read_rgb
from carigs.errors import InputError
from carigs.exaggeration import Caricature
from carigs.head import neutral, pose
from carigs.raster import rasterize_mesh
from evaluation.metrics.image_quality import IMAGE_METRICS
from evaluation.metrics.regions import image_regions, surface_regions
from evaluation.tables.metric_records import REGIONS, MetricRecord, StudyPoint, metric_record


def truth_records(
    point: StudyPoint,
    rendered: list[RenderedImage],
    truths: GroundTruth,
    subject: Capture,
    caricature: Caricature,
    *,
    band: int,
) -> Iterator[MetricRecord]:
    """Compare every `test` and `val` frame with its true image.

    Args:
        point: Avatar and level.
        rendered: Rendered frames.
        truths: True images, or the reason why there are none.
        subject: The capture.
        caricature: Caricature at the rendered level.
        band: Half width of the silhouette region in pixels.

    Yields:
        One record per frame, region and metric; without a value where there is no truth or no pixel of the region.

    Raises:
        InputError: An image has another size than its camera.
    """
    rendered = [frame for frame in rendered if frame.protocol in ("test", "val")]
    if truths.reason is not None:
        for protocol, region, metric in product(sorted({frame.protocol for frame in rendered}), REGIONS, IMAGE_METRICS):
            yield metric_record(point, protocol, (None, None), region, metric, None, truths.reason)
        return
    surface = posed = None
    for frame in track(rendered, description="against the truth", disable=len(rendered) < 10):
        record = partial(metric_record, point, frame.protocol, (frame.camera, frame.timestep))
        key = (frame.timestep, frame.camera)
        if key not in truths.images:
            for metric in IMAGE_METRICS:
                yield record("full", metric, None, "no true image of this frame")
            continue
        image, truth = read_rgb(frame.file), read_rgb(truths.images[key])
        foreground = read_grey(truths.masks[key]) > 0.5
        camera = subject.camera(subject.frame_at[key])
        for array, file in ((image, frame.file), (truth, truths.images[key]), (foreground, truths.masks[key])):
            if array.shape[:2] != (camera.height, camera.width):
                size = f"{array.shape[1]} x {array.shape[0]} pixels"
                raise InputError(f"{size}, its camera has {camera.width} x {camera.height}", file=file)
        if posed is None or posed[0] != frame.timestep:  # frames are in order of their timestep
            parameters = subject.parameters(frame.timestep)
            posed = frame.timestep, pose(subject.model, parameters, caricature)
        vertices = posed[1]
        if surface is None:
            surface = surface_regions(subject.model, neutral(subject.model, parameters))
        fragments = rasterize_mesh(vertices, subject.model.faces, camera)
        regions = image_regions(surface, vertices, fragments, camera, foreground, band=band)
        size = camera.height * camera.width
        maps = {name: metric.pixel_map(image, truth).reshape(size, -1) for name, metric in IMAGE_METRICS.items()}
        for region in REGIONS:
            if region not in regions:
                inside, reason = None, surface.missing[region]
            else:
                inside = np.flatnonzero(regions[region])
                reason = "" if inside.size else "no pixel of this region in view"
            for name, metric in IMAGE_METRICS.items():
                yield record(region, name, None if reason else metric.summarise(maps[name][inside]), reason)
