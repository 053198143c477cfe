"""Metrics of rendered images alone: against the truth, sharpness, photo-consistency, flicker."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby, product

from rich.progress import track

from carigs.capture import Capture
from carigs.capture.frame_index import GroundTruth, RenderedImage
from carigs.exaggeration import Caricature
from carigs.head import neutral
from carigs.settings import Metrics
from evaluation.metrics.against_truth import truth_records
from evaluation.metrics.frame_views import frame_views
from evaluation.metrics.image_quality import IMAGE_METRICS
from evaluation.metrics.lpips import LPIPS_REGIONS, load_lpips_metrics
from evaluation.metrics.photo_consistency import TRUE_CONSISTENCY, consistency_records, flicker_records
from evaluation.metrics.regions import surface_regions
from evaluation.metrics.sharpness import sharpness_records
from evaluation.tables.metric_records import REGIONS, MetricRecord, StudyPoint, metric_record

SILHOUETTE_BAND = 2
"""Half width of the region `silhouette`, in pixels."""


def image_records(
    point: StudyPoint,
    rendered: Sequence[RenderedImage],
    truths: GroundTruth,
    subject: Capture,
    caricature: Caricature,
    settings: Metrics,
    threads: int = 1,
) -> Iterator[MetricRecord]:
    """Measure all frames; every image is read once, and the mesh is rasterised once per timestep and camera.

    Args:
        point: Avatar and level.
        rendered: Rendered frames, sorted by protocol, then order.
        truths: True images, or the reason why there are none.
        subject: The capture.
        caricature: Caricature at the rendered level.
        settings: Settings of the stage `metrics`.
        threads: Threads of the networks; the result does not depend on it.

    Yields:
        One record per frame, region and metric; without a value where it cannot be measured, as without test frames.

    Raises:
        InputError: An image has another size than its camera, the capture lacks the original of a frame, or the weights
            of LPIPS are not those of the registry.
        WeightsMissing: Weights of LPIPS are missing and `settings.strict` is set.
    """
    protocols = _protocols(rendered)
    if "test" not in protocols:
        yield from _without_truth(point, ("test",), settings.lpips, "no test frame was rendered")
    if not rendered:
        return
    parameters = subject.parameters(next(iter(subject.parameter_files)))
    surface = surface_regions(subject.model, neutral(subject.model, parameters))
    networks, missing = load_lpips_metrics(settings, threads) if truths.reason is None else ({}, {})
    for protocol, region, (metric, reason) in product(protocols, LPIPS_REGIONS, missing.items()):
        yield metric_record(point, protocol, (None, None), region, metric, None, reason)
    if truths.reason is not None:
        yield from _without_truth(point, protocols, settings.lpips, truths.reason)
    followed = track(rendered, description="measuring images", disable=len(rendered) < 10)
    views = frame_views(followed, truths, subject, caricature)
    for protocol, frames in groupby(views, key=lambda view: view.rendered.protocol):
        if protocol == "orbit":
            yield from flicker_records(point, frames, surface)
            continue
        for _, timestep in groupby(frames, key=lambda view: view.rendered.timestep):
            cameras = list(timestep)
            for view in cameras:
                if truths.reason is None:
                    yield from truth_records(point, view, surface, networks, band=SILHOUETTE_BAND)
                yield from sharpness_records(point, view, surface, margin=SILHOUETTE_BAND)
            if protocol == "test":
                yield from consistency_records(point, cameras, surface)


def _without_truth(
    point: StudyPoint, protocols: Sequence[str], lpips: Sequence[str], reason: str
) -> Iterator[MetricRecord]:
    """Records without a value of everything that needs true images."""
    regions = [*product(REGIONS, IMAGE_METRICS), *product(LPIPS_REGIONS, lpips), ("full", "sharpness")]
    for protocol, (region, metric) in product(protocols, regions):
        yield metric_record(point, protocol, (None, None), region, metric, None, reason)
    if "test" in protocols:
        yield metric_record(point, "test", (None, None), "full", TRUE_CONSISTENCY, None, reason)


def _protocols(rendered: Sequence[RenderedImage]) -> list[str]:
    """Protocols of frames of the capture's cameras."""
    return sorted({frame.protocol for frame in rendered} - {"orbit"})
