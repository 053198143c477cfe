"""Stage `metrics`: rendered frames against the truth and against each other, and by networks."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from pathlib import Path

from carigs.capture import Capture
from carigs.capture.frame_index import RenderedImage, level_folder, read_frame_index, read_ground_truth
from carigs.errors import CarigsWarning
from carigs.head import read_subject_path
from carigs.settings import Metrics
from evaluation.metrics.embeddings import embedding_records, embedding_weights
from evaluation.metrics.identity import identity_records
from evaluation.metrics.image_records import image_records
from evaluation.metrics.networks.embedding_cache import EmbeddingCache
from evaluation.metrics.networks.embedding_networks import EmbeddingNetworks
from evaluation.metrics.stable_diffusion import sd_records
from evaluation.tables.frame_records import read_frame_records
from evaluation.tables.metric_records import MetricRecord, StudyPoint, write_metrics


def metrics(
    settings: Metrics,
    *,
    frames: Path,
    capture: Path,
    path: Path,
    truths: Sequence[Path],
    study: str,
    subject: str,
    variant: str,
    seed: int,
    gamma: float,
    levels: Sequence[float],
    embeddings: str,
    records: Path,
    threads: int = 1,
) -> None:
    """Write metric records: one line per frame, region and metric.

    Args:
        settings: Networks and prompts.
        frames: Folder with the renderings of all levels, and the metrics of the avatar's geometry, as the stage
            `render` writes it.
        capture: Index of the capture.
        path: Caricature path of the subject.
        truths: Index of the true images of each level.
        study: Name of the study.
        subject: Name of the subject.
        variant: Name of the variant.
        seed: Seed of the training.
        gamma: Level that the avatar is trained for.
        levels: Rendered levels; the frames of level 0 are needed in any case.
        embeddings: Folder with the embeddings of images that are known already; it need not exist.
        records: CSV file to write; a metric that cannot be computed has an empty value and a reason.
        threads: Threads of the networks; the result does not depend on it.

    Warns:
        CarigsWarning: A metric has no value at all.

    Raises:
        InputError: An input is malformed, or a file of weights is damaged.
        WeightsMissing: Network weights are missing and `settings.strict` is set.
    """
    weights = embedding_weights(settings)
    person = Capture.load(capture)
    gamma_path, unedited = read_subject_path(path, person.model), _rendered(frames, 0.0)
    networks = EmbeddingNetworks(settings, person.background, EmbeddingCache(Path(embeddings)), threads)
    measured: list[MetricRecord] = []
    for level, truth in zip(levels, truths, strict=True):
        point = StudyPoint(study, subject, variant, seed, gamma, level, person.split_rule)
        rendered = _rendered(frames, level)
        # Frames of an avatar whose mesh is not exaggerated say so: they are measured on the mesh that they show.
        caricature = gamma_path.at(next((f.mesh_level for f in rendered if f.mesh_level is not None), level))
        measured += read_frame_records(level_folder(frames, level) / "geometry.csv", point)
        measured += image_records(point, rendered, read_ground_truth(truth), person, caricature, settings, threads)
        measured += embedding_records(point, rendered, unedited, person, networks, weights)
        measured += sd_records(point, rendered, person, settings, threads)
        if settings.identity:
            measured += identity_records(point, rendered, person, caricature, settings)
    write_metrics(records, measured)
    _warn_of_empty_metrics(measured)


def _rendered(frames: Path, level: float) -> list[RenderedImage]:
    return read_frame_index(level_folder(frames, level) / "frames.json")


def _warn_of_empty_metrics(records: list[MetricRecord]) -> None:
    """Warn of metrics that have no value at all; each reason once."""
    known = {record.metric for record in records if record.value is not None}
    empty: dict[str, list[str]] = {}
    for record in records:
        if record.metric not in (*known, *empty.get(record.reason, ())):
            empty.setdefault(record.reason, []).append(record.metric)
    for reason, names in empty.items():
        warnings.warn(f"no value of {', '.join(names)}: {reason}", CarigsWarning, stacklevel=2)
