"""CLIP and DINO scores of rendered frames: the metrics of table 1 that need network weights."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np
from jaxtyping import Float
from rich.progress import track

from carigs.capture import Capture
from carigs.capture.frame_index import RenderedImage
from carigs.capture.images import read_rgb
from carigs.errors import InputError, WeightsMissing
from carigs.settings import Metrics
from evaluation.metrics import clip, dino
from evaluation.metrics.preprocessing import CLIP_STATISTICS, IMAGENET_STATISTICS, preprocess
from evaluation.metrics.weights import find_weights, registered
from evaluation.tables.metric_records import MetricRecord, StudyPoint, metric_record

BATCH = 8
WEIGHTS = {"clip": clip.WEIGHTS, "dino": "dino_vitb8"}
METRICS = {
    "clip": (("test", "clip_i_cos"), ("test", "clip_i_score_w2.5"), ("test", "clip_d"), ("orbit", "clip_c_adjacent")),
    "dino": (("test", "dino_vitb8_cls"),),
}
"""Protocol and metric names of each network."""


@dataclass
class Embedder:
    """Embeds image files, each at most once."""

    network: Callable
    """Maps a batch of preprocessed images (n, 3, s, s) to embeddings (n, d)."""
    prepare: Callable
    """Maps an image (h, w, 3) to a preprocessed tensor."""
    embedded: dict[Path, Float[np.ndarray, " d"]] = field(default_factory=dict)

    def __call__(self, files: Sequence[Path]) -> Float[np.ndarray, "n d"]:
        """Embed image files.

        Args:
            files: Images.

        Returns:
            Normalised float64 embeddings, in the order of the files.
        """
        import torch

        remaining = [file for file in dict.fromkeys(files) if file not in self.embedded]
        batches = [remaining[i : i + BATCH] for i in range(0, len(remaining), BATCH)]
        for batch in track(batches, description="embedding", disable=len(batches) < 3):
            with torch.inference_mode():
                vectors = self.network(torch.stack([self.prepare(read_rgb(file)) for file in batch])).double().numpy()
            vectors /= np.linalg.norm(vectors, axis=1, keepdims=True)
            self.embedded.update(zip(batch, vectors, strict=True))
        return np.stack([self.embedded[file] for file in files])


def embedding_records(
    point: StudyPoint, rendered: list[RenderedImage], subject: Capture, settings: Metrics
) -> Iterator[MetricRecord]:
    """Compute the metrics of the networks in `settings.embeddings`.

    Network libraries are imported only once weights are found.

    Args:
        point: Avatar and level.
        rendered: Rendered frames.
        subject: The capture, with the original frames.
        settings: Settings of the stage `metrics`.

    Yields:
        One record per frame and metric; one without a value for a metric that cannot be computed.

    Raises:
        WeightsMissing: Weights are missing and `settings.strict` is set.
        InputError: The capture lacks the original of a rendered frame.
    """
    frames = {protocol: [frame for frame in rendered if frame.protocol == protocol] for protocol in ("test", "orbit")}
    for name in settings.embeddings:
        scores, reason = {}, ""
        try:
            weights = find_weights(registered(WEIGHTS[name]), settings.weights, download=settings.download)
        except WeightsMissing as error:
            if settings.strict:
                raise
            reason = str(error)
        else:
            if not settings.download:
                # Read when the hub's client is imported, which otherwise waits for a network.
                os.environ.setdefault("HF_HUB_OFFLINE", "1")
            test, orbit = ([frame.file for frame in frames[protocol]] for protocol in ("test", "orbit"))
            originals = _originals(frames["test"], subject)
            prepare = partial(preprocess, size=224, crop=settings.crop, background=subject.background)
            if name == "clip":
                network = clip.load_clip(weights)
                embed = Embedder(network.encode_image, partial(prepare, statistics=CLIP_STATISTICS))
                texts = clip.embed_texts(network, [settings.source_prompt, settings.edit_prompt])
                scores = clip_scores(embed, texts, test, originals, orbit)
            elif test:
                embed = Embedder(dino.load_dino(weights), partial(prepare, statistics=IMAGENET_STATISTICS))
                scores = {"dino_vitb8_cls": dino.dino_similarity(embed(test), embed(originals))}
        for protocol, metric in METRICS[name]:
            if metric not in scores:
                why = reason or f"too few {protocol} frames were rendered"
                yield metric_record(point, protocol, (None, None), "full", metric, None, why)
                continue
            for frame, value in zip(frames[protocol], scores[metric], strict=False):  # CLIP-C: of a frame and its next
                yield metric_record(point, protocol, (frame.camera, frame.timestep), "full", metric, float(value))


def clip_scores(
    embed: Embedder,
    texts: Float[np.ndarray, "2 d"],
    test: Sequence[Path],
    originals: Sequence[Path],
    orbit: Sequence[Path],
) -> dict[str, Float[np.ndarray, " _"]]:
    """CLIP-I (both readings) and CLIP-D of the test frames, and CLIP-C of the orbit.

    Args:
        embed: Embedder with the CLIP network.
        texts: Embeddings of the source and the edit prompt.
        test: Rendered test frames.
        originals: Original frames of the capture, one for each of `test`.
        orbit: Frames of the novel trajectory, in its order.

    Returns:
        Values by name of the metric; a metric without frames is absent.
    """
    source, edit = texts
    scores = {}
    if test:
        edited = embed(test)
        scores["clip_i_cos"] = clip.clip_i(edited, edit)
        scores["clip_i_score_w2.5"] = clip.clip_i_score(edited, edit)
        scores["clip_d"] = clip.clip_d(edited, embed(originals), edit, source)
    if len(orbit) > 1:
        scores["clip_c_adjacent"] = clip.clip_c(embed(orbit))
    return scores


def _originals(test: list[RenderedImage], subject: Capture) -> list[Path]:
    """The capture's own image of each test frame."""
    images = {(frame.timestep, frame.camera): subject.root / frame.image for frame in subject.frames}
    for frame in test:
        if (frame.timestep, frame.camera) not in images:
            missing = f"timestep {frame.timestep}, camera {frame.camera}"
            raise InputError(f"the capture has no frame of {missing}", file=frame.file)
    return [images[frame.timestep, frame.camera] for frame in test]
