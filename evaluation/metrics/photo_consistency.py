"""Do two rendered images agree on the surface that both show? Neighbouring cameras, and neighbouring orbit frames."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from evaluation.metrics.frame_views import FrameView
from evaluation.metrics.regions import MESH_REGIONS, SurfaceRegions, mesh_regions
from evaluation.metrics.view_warping import correspondence, nearest_views
from evaluation.tables.metric_records import MetricRecord, StudyPoint, metric_record

CONSISTENCY, TRUE_CONSISTENCY, FLICKER = "photo_consistency_l1", "photo_consistency_l1_truth", "flicker_l1"


def consistency_records(
    point: StudyPoint, views: Sequence[FrameView], surface: SurfaceRegions
) -> Iterator[MetricRecord]:
    """Compare each frame of a timestep with that of the nearest camera, warped by the depth of the mesh.

    The same difference between the true images is what light that depends on the view, hair and sampling cause in a
    perfect avatar.

    Args:
        point: Avatar and level.
        views: All frames of one timestep.
        surface: Regions of the subject's surface.

    Yields:
        Mean absolute difference by frame and region, of the rendered images and, where there are some, the true ones.
    """
    if len(views) == 1:
        yield _record(point, views[0])("full", CONSISTENCY, None, "no other camera at this timestep")
        return
    nearest = nearest_views([view.camera for view in views], views[0].head.vertices.mean(axis=0))
    for view, other in zip(views, (views[i] for i in nearest), strict=True):
        shared = correspondence(view.visibility, other.visibility)
        differences = {CONSISTENCY: shared.difference(view.image8, other.image8)}
        if view.truth is not None and other.truth is not None:
            differences[TRUE_CONSISTENCY] = shared.difference(view.truth8, other.truth8)
        for metric, difference in differences.items():
            yield from _region_means(point, view, surface, metric, difference, shared.seen)


def flicker_records(point: StudyPoint, orbit: Iterator[FrameView], surface: SurfaceRegions) -> Iterator[MetricRecord]:
    """Compare each frame of the orbit with the next one, warped by the depth of the mesh.

    Args:
        point: Avatar and level.
        orbit: Frames of the orbit in order.
        surface: Regions of the subject's surface.

    Yields:
        Mean absolute difference by frame, but for the last one, and region.
    """
    for view, following in pairwise(orbit):
        shared = correspondence(view.visibility, following.visibility)
        difference = shared.difference(view.image8, following.image8)
        yield from _region_means(point, view, surface, FLICKER, difference, shared.seen)


def _region_means(
    point: StudyPoint,
    view: FrameView,
    surface: SurfaceRegions,
    metric: str,
    difference: Float[np.ndarray, " n"],
    seen: Bool[np.ndarray, "h w"],
) -> Iterator[MetricRecord]:
    """Records of the mean difference in each region; the difference is that of the pixels of `seen`."""
    record, regions = _record(point, view), mesh_regions(surface, view.visibility.face)
    for region in MESH_REGIONS:
        if region not in regions:
            yield record(region, metric, None, surface.missing[region])
            continue
        inside = difference[regions[region][seen]]
        mean = float(inside.mean(dtype=np.float64)) if inside.size else None
        yield record(region, metric, mean, "" if inside.size else "both views show no pixel of this region")


def _record(point: StudyPoint, view: FrameView) -> partial[MetricRecord]:
    frame = view.rendered
    return partial(metric_record, point, frame.protocol, (frame.camera, frame.timestep))
