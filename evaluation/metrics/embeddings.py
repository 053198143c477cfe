"""CLIP and DINO rows of the rendered frames; null, with the reason, where weights are missing."""

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
from evaluation.tables.rows import Row, Scene, row

BATCH = 8
WEIGHTS = {"clip": "clip_vit_b32_openai", "dino": "dino_vitb8"}
METRICS = {
    "clip": (("test", "clip_i_cos"), ("test", "clip_i_score_w2.5"), ("test", "clip_d"), ("orbit", "clip_c_adjacent")),
    "dino": (("test", "dino_vitb8_cls"),),
}
"""Protocol and metric names of each network."""

Scores = dict[str, Float[np.ndarray, "_"]]
"""Values of each metric, by frame."""


@dataclass
class Embedder:
    """Embeds image files, each at most once."""

    network: Callable
    """From a batch of preprocessed images (n, 3, s, s) to embeddings (n, d)."""
    prepare: Callable
    """From an image (h, w, 3) to a preprocessed tensor."""
    done: dict[Path, Float[np.ndarray, "d"]] = field(default_factory=dict)

    def __call__(self, files: Sequence[Path]) -> Float[np.ndarray, "n d"]:
        """Normalised float64 embeddings of the files, in their order."""
        import torch

        todo = [file for file in dict.fromkeys(files) if file not in self.done]
        batches = [todo[i : i + BATCH] for i in range(0, len(todo), BATCH)]
        for batch in track(batches, description="embedding", disable=len(batches) < 3):
            with torch.inference_mode():
                found = self.network(torch.stack([self.prepare(read_rgb(file)) for file in batch])).double().numpy()
            found /= np.linalg.norm(found, axis=1, keepdims=True)
            self.done.update(zip(batch, found, strict=True))
        return np.stack([self.done[file] for file in files])


def embedding_rows(scene: Scene, rendered: list[RenderedImage], subject: Capture, settings: Metrics) -> Iterator[Row]:
    """Rows of the networks in `settings.embeddings`.

    What cannot be measured gives one null row per metric; missing weights raise `WeightsMissing` with
    `settings.strict`.  Network libraries are imported only once weights are found.
    """
    frames = {protocol: [frame for frame in rendered if frame.protocol == protocol] for protocol in ("test", "orbit")}
    for name in settings.embeddings:
        scores, reason = {}, ""
        try:
            file = find_weights(registered(WEIGHTS[name]), settings.weights, download=settings.download)
        except WeightsMissing as error:
            if settings.strict:
                raise
            reason = str(error)
        else:
            if not settings.download:
                # Read when the hub's client is imported, which else waits for a network.
                os.environ.setdefault("HF_HUB_OFFLINE", "1")
            files = {protocol: [frame.file for frame in frames[protocol]] for protocol in frames}
            originals = _originals(frames["test"], subject)
            measure = {"clip": _clip, "dino": _dino}[name]
            scores = measure(file, files, originals, subject, settings)
        for protocol, metric in METRICS[name]:
            if metric not in scores:
                why = reason or f"too few {protocol} frames were rendered"
                yield row(scene, protocol, (None, None), "full", metric, None, why)
                continue
            for frame, value in zip(frames[protocol], scores[metric], strict=False):  # CLIP-C: of a frame and its next
                yield row(scene, protocol, (frame.camera, frame.timestep), "full", metric, float(value))


def clip_scores(
    embed: Embedder,
    texts: Float[np.ndarray, "2 d"],
    test: Sequence[Path],
    originals: Sequence[Path],
    orbit: Sequence[Path],
) -> Scores:
    """CLIP-I (both readings) and CLIP-D of the test frames, CLIP-C of the orbit; `texts` are source and edit prompt."""
    source, edit = texts
    scores = {}
    if test:
        edited = embed(test)
        scores["clip_i_cos"] = clip.text_cosine(edited, edit)
        scores["clip_i_score_w2.5"] = clip.clip_score(edited, edit)
        scores["clip_d"] = clip.directional(edited, embed(originals), edit, source)
    if len(orbit) > 1:
        scores["clip_c_adjacent"] = clip.adjacent(embed(orbit))
    return scores


def _clip(file: Path, files: dict[str, list[Path]], originals: list[Path], subject: Capture, settings: Metrics):
    model = clip.load_clip(file)
    prepare = partial(
        preprocess, size=224, statistics=CLIP_STATISTICS, crop=settings.crop, background=subject.background
    )
    texts = clip.embed_texts(model, [settings.source_prompt, settings.edit_prompt])
    return clip_scores(Embedder(model.encode_image, prepare), texts, files["test"], originals, files["orbit"])


def _dino(file: Path, files: dict[str, list[Path]], originals: list[Path], subject: Capture, settings: Metrics):
    if not files["test"]:
        return {}
    prepare = partial(
        preprocess, size=224, statistics=IMAGENET_STATISTICS, crop=settings.crop, background=subject.background
    )
    embed = Embedder(dino.load_dino(file), prepare)
    return {"dino_vitb8_cls": dino.paired_cosine(embed(files["test"]), embed(originals))}


def _originals(test: list[RenderedImage], subject: Capture) -> list[Path]:
    """The capture's own image of each test frame."""
    images = {(frame.timestep, frame.camera): subject.root / frame.image for frame in subject.frames}
    for frame in test:
        if (frame.timestep, frame.camera) not in images:
            raise InputError(
                f"the capture has no frame of timestep {frame.timestep}, camera {frame.camera}", file=frame.file
            )
    return [images[frame.timestep, frame.camera] for frame in test]
