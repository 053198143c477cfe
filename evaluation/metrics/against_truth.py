"""PSNR, SSIM and LPIPS of rendered frames against the true images of the same frames, by region."""

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
from carigs.settings import Metrics
from evaluation.metrics.image_quality import IMAGE_METRICS
from evaluation.metrics.lpips import LPIPS_METRICS, LPIPS_REGIONS, SMALLEST_IMAGE, load_lpips_metrics, lpips
from evaluation.metrics.regions import image_regions, surface_regions
from evaluation.tables.metric_records import REGIONS, MetricRecord, StudyPoint, metric_record


def truth_records(
    point: StudyPoint,
    rendered: list[RenderedImage],
    truths: GroundTruth,
    subject: Capture,
    caricature: Caricature,
    settings: Metrics,
) -> Iterator[MetricRecord]:
    """Compare every `test` and `val` frame with its true image.

    Args:
        point: Avatar and level.
        rendered: Rendered frames.
        truths: True images, or the reason why there are none.
        subject: The capture.
        caricature: Caricature at the rendered level.
        settings: Settings of the stage `metrics`.

    Yields:
        One record per frame, region and metric; without a value where there is no truth or no pixel of the region.

    Raises:
        InputError: An image has another size than its camera, or weights are not those of the registry.
        WeightsMissing: Weights of LPIPS are missing and `settings.strict` is set.
    """
    rendered = [frame for frame in rendered if frame.protocol in ("test", "val")]
    protocols = sorted({frame.protocol for frame in rendered})
    if truths.reason is not None:
        names = [*product(REGIONS, IMAGE_METRICS), *product(LPIPS_REGIONS, settings.lpips)]
        for protocol, (region, metric) in product(protocols, names):
            yield metric_record(point, protocol, (None, None), region, metric, None, truths.reason)
        return
    networks, missing = load_lpips_metrics(settings)
    for protocol, region, (metric, reason) in product(protocols, LPIPS_REGIONS, missing.items()):
        yield metric_record(point, protocol, (None, None), region, metric, None, reason)
    surface = posed = None
    for frame in track(rendered, description="against the truth", disable=len(rendered) < 10):
        record = partial(metric_record, point, frame.protocol, (frame.camera, frame.timestep))
        key = (frame.timestep, frame.camera)
        if key not in truths.images:
            for metric in (*IMAGE_METRICS, *networks):
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
        regions = image_regions(surface, vertices, fragments, camera, foreground, band=settings.silhouette_band)
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
        for name, network in networks.items():
            distances, reason = {}, f"images of less than {SMALLEST_IMAGE} pixels have no LPIPS"
            if min(camera.height, camera.width) >= SMALLEST_IMAGE:
                inside = {region: regions[region] for region in LPIPS_REGIONS}
                distances = lpips(network, image, truth, inside, normalize=LPIPS_METRICS[name].normalize)
                reason = ""
            for region in LPIPS_REGIONS:
                yield record(region, name, distances.get(region), reason)
