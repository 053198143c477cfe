"""CLIP and DINO scores of rendered frames: the metrics of table 1 that compare embeddings of networks."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

from carigs.capture import Capture
from carigs.capture.frame_index import RenderedImage
from carigs.errors import WeightsMissing
from carigs.settings import Metrics
from carigs.weights.offline import work_offline
from carigs.weights.registry import registered
from carigs.weights.search import find_weights
from evaluation.metrics.frame_sequences import frame_sequences
from evaluation.metrics.networks import clip
from evaluation.metrics.networks.embedding_networks import EmbeddingNetworks, Scores
from evaluation.tables.metric_records import MetricRecord, StudyPoint, metric_record

CONSISTENCY = ("clip_c_adjacent", "clip_c_unedited", "clip_c_dir_edit", "clip_c_dir_motion")
CLIP_METRICS = (
    *(("test", metric) for metric in ("clip_i_cos", "clip_i_score_w2.5", "clip_i_image", "clip_d", *CONSISTENCY)),
    *(("orbit", metric) for metric in CONSISTENCY),
)
"""Protocols and metrics of CLIP."""
DINO_METRICS = {
    "dino_vits16": ("dino_vits16", "cls", "dino_vits16_cls"),
    "dino_vitb8": ("dino_vitb8", "cls", "dino_vitb8_cls"),
    "dino_vitb8_patch_l11": ("dino_vitb8", "patch_l11", "dino_vitb8_patch_l11"),
}
"""Entry of the registry of weights, output of the network, and metric, by the choices of `metrics.embeddings`."""
EMBEDDINGS = ("clip", *DINO_METRICS)
"""The choices of `metrics.embeddings`."""


def embedding_weights(settings: Metrics) -> dict[str, Path | WeightsMissing]:
    """Find the weights of the networks in `settings.embeddings`, before any work is done.

    Args:
        settings: Settings of the stage `metrics`.

    Returns:
        The file, or why there is none, by entry of the registry.

    Raises:
        WeightsMissing: Weights are missing and `settings.strict` is set.
        InputError: A file has another size or checksum than the registry states. An empty value would hide that.
    """
    work_offline()
    found: dict[str, Path | WeightsMissing] = {}
    for name in _networks(settings):
        try:
            found[name] = find_weights(registered(name), settings.weights)
        except WeightsMissing as error:
            if settings.strict:
                raise
            found[name] = error
    return found


def embedding_records(
    point: StudyPoint,
    rendered: list[RenderedImage],
    unedited: list[RenderedImage],
    subject: Capture,
    networks: EmbeddingNetworks,
    weights: Mapping[str, Path | WeightsMissing],
) -> Iterator[MetricRecord]:
    """Compute the metrics of the networks in `settings.embeddings`.

    CLIP-C compares each frame of a sequence with its next. The orbit is one sequence, by azimuth; of the test frames
    each camera is one, by timestep. The record names the first frame of the two.

    Args:
        point: Avatar and level.
        rendered: Rendered frames.
        unedited: The same frames rendered at level 0.
        subject: The capture, with the original frames.
        networks: The networks, which levels share so that each is loaded once, with their settings.
        weights: Of `embedding_weights`.

    Yields:
        One record per frame and metric; one without a value for a metric that cannot be computed.

    Raises:
        InputError: The original of a rendered frame is missing, or weights cannot be read or do not fit their network.
    """
    sequences = frame_sequences(rendered, unedited, subject)
    for name, outputs in _networks(networks.settings).items():
        file, scores = weights[name], Scores()
        reason = "too few frames were rendered"
        if isinstance(file, WeightsMissing):
            reason = str(file)
        elif name == clip.WEIGHTS:
            scores = networks.clip_scores(file, sequences)
        else:
            scores = networks.dino_scores(name, file, sequences, outputs)
        for protocol, metric in CLIP_METRICS if name == clip.WEIGHTS else [("test", m) for m in outputs.values()]:
            record = partial(metric_record, point, protocol)
            values = scores.get((protocol, metric))
            for frame, value in values or ():
                yield record((frame.camera, frame.timestep), "full", metric, float(value))
            if not values:
                yield record((None, None), "full", metric, None, reason)


def _networks(settings: Metrics) -> dict[str, dict[str, str]]:
    """Entries of the registry of weights; of DINO with the metric of each output."""
    found: dict[str, dict[str, str]] = {}
    for choice in settings.embeddings:
        if choice == "clip":
            found[clip.WEIGHTS] = {}
        else:
            name, output, metric = DINO_METRICS[choice]
            found.setdefault(name, {})[output] = metric
    return found
