"""Metric records: one value per metric, region and frame, as the stage `metrics` writes them."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from evaluation.tables.csv_files import write_csv

REGIONS = ("full", "head", "hair", "face", "eyes", "brow", "mouth", "silhouette", "skin", "neck_ear", "head_hm")
"""Regions of a frame, in the order of the tables; `evaluation.metrics.regions` defines them."""


class StudyPoint(NamedTuple):
    """The avatar and level that were rendered: the same for all records of one file."""

    study: str
    subject: str
    variant: str
    seed: int
    """Of the training."""
    gamma: float
    level: float
    split: str
    """How the capture was divided into training and held-out frames (`carigs.capture.splits`)."""


class MetricRecord(NamedTuple):
    """Value of one metric in one region of one frame."""

    study: str
    subject: str
    variant: str
    seed: int
    gamma: float
    level: float
    split: str
    protocol: str
    camera: int | None
    """None in a record that stands for all cameras of the timestep, and, as is `timestep`, for all frames."""
    timestep: int | None
    region: str
    metric: str
    value: float | None
    """None where the metric could not be computed."""
    reason: str
    """Reason why there is no value; empty otherwise."""


def metric_record(
    point: StudyPoint,
    protocol: str,
    frame: tuple[int | None, int | None],
    region: str,
    metric: str,
    value: float | None,
    reason: str = "",
) -> MetricRecord:
    """Build a record; a value that is not finite becomes None with a reason.

    Args:
        point: Avatar and level.
        protocol: `test` (held-out sequence), `val` (held-out camera) or `orbit`.
        frame: Camera and timestep, or None twice.
        region: One of `REGIONS`.
        metric: Name of the metric.
        value: Its value.
        reason: Reason why there is no value.

    Returns:
        The record.
    """
    if value is not None and not math.isfinite(value):
        value, reason = None, reason or ("infinite: both images agree exactly" if value > 0 else "not a number")
    return MetricRecord(*point, protocol, *frame, region, metric, value, reason)


def write_metrics(file: Path, records: Iterable[MetricRecord]) -> None:
    """Write records as CSV; values keep nine significant digits.

    Args:
        file: File to write; `evaluation.tables.summary.read_metrics` reads it.
        records: Records of one study point.
    """
    write_csv(file, records, MetricRecord, digits=9)
