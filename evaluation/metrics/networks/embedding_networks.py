"""CLIP and DINO on sequences of frames: which frames are embedded, and which scores are made of them."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from carigs.capture.frame_index import RenderedImage
from carigs.runs.sources import fingerprint, package_versions
from carigs.settings import Metrics
from carigs.weights.checksums import file_checksum
from evaluation.metrics.frame_sequences import Sequences
from evaluation.metrics.networks import clip, dino, preprocessing
from evaluation.metrics.networks.embedder import Embedder
from evaluation.metrics.networks.embedding_cache import EmbeddingCache, digest_of

if TYPE_CHECKING:
    import torch

CHUNK = 32
"""Pairs of images whose DINO features are in memory together: those of all patches have 600 000 numbers."""
Scores = dict[tuple[str, str], list[tuple[RenderedImage, float]]]
"""Frames and their values by protocol and metric."""


@dataclass
class EmbeddingNetworks:
    """What the networks of a study share. A network is loaded, once, when an image is not in the cache."""

    settings: Metrics
    background: float
    """Grey value in [0, 1] behind the person."""
    cache: EmbeddingCache
    threads: int = 1
    """Threads of the networks; scores do not depend on it."""
    _loaded: dict[tuple, torch.nn.Module] = field(default_factory=dict)
    _pixels: dict[Path, str] = field(default_factory=dict)

    def clip_scores(self, file: Path, sequences: Sequences) -> Scores:
        """CLIP-I and CLIP-D of the test frames, and CLIP-C of all sequences.

        Args:
            file: Weights of CLIP.
            sequences: Frames in order.

        Returns:
            The scores.

        Raises:
            InputError: The weights cannot be read or do not fit the network.
        """
        model = partial(self._network, clip.load_clip, file)
        embed = self._embedder("clip", file, lambda images: {"image": model().encode_image(images)}, clip.STATISTICS)
        prompts = (self.settings.source_prompt, self.settings.edit_prompt)
        texts = np.stack([self._text(embed, prompt, model) for prompt in prompts])
        embed.fill([file for several in sequences.values() for file in _files(several)], "image")
        scores: Scores = defaultdict(list)
        for protocol, several in sequences.items():
            for sequence in several:
                frames, originals = zip(*sequence, strict=True)
                edited, original = embed([frame.file for frame in frames], "image"), embed(originals, "image")
                found = consistency_scores(edited, original)
                if protocol == "test":
                    found |= frame_scores(edited, original, texts)
                for metric, values in found.items():
                    scores[protocol, metric] += zip(frames, values, strict=False)  # CLIP-C: of a frame and its next
        return scores

    def dino_scores(self, name: str, file: Path, sequences: Sequences, outputs: dict[str, str]) -> Scores:
        """Similarity of the test frames and the capture's own.

        Args:
            name: Entry of the registry of weights.
            file: Its weights.
            sequences: Frames in order.
            outputs: Metric by output of the network, `cls` or `patch_l11`. One pass gives both.

        Returns:
            The scores.

        Raises:
            InputError: The weights cannot be read or do not fit the network.
        """
        model = partial(self._network, dino.load_dino, file, dino.MODELS[name])

        def forward(images: torch.Tensor) -> dict[str, torch.Tensor]:
            if "patch_l11" not in outputs:
                return {"cls": model()(images)}
            return dict(zip(("cls", "patch_l11"), dino.class_and_patch_tokens(model(), images), strict=True))

        embed = self._embedder(name, file, forward, dino.STATISTICS)
        pairs = [pair for sequence in sequences["test"] for pair in sequence]
        scores: Scores = {}
        for output, metric in sorted(outputs.items(), reverse=True):  # the pass of `patch_l11` gives `cls`, too
            embed.fill(_files(sequences["test"]), output)
            values = scores["test", metric] = []
            for i in range(0, len(pairs), CHUNK):
                frames, originals = zip(*pairs[i : i + CHUNK], strict=True)
                similar = dino.dino_similarity(
                    embed([frame.file for frame in frames], output), embed(originals, output)
                )
                values += zip(frames, similar, strict=True)
        return scores

    def _embedder(self, name: str, file: Path, forward: Callable, statistics: tuple) -> Embedder:
        code = [fingerprint(module.__name__) for module in (preprocessing, clip, dino)]
        packages = [f"{package} {version}" for package, version in package_versions(__name__).items()]
        identity = digest_of(file_checksum(file), *code, *packages)
        prepare = preprocessing.Preprocessing(*statistics, self.settings.crop, round(255 * self.background))
        return Embedder(name, identity, forward, prepare, self.cache, self.background, self._pixels)

    def _text(self, embed: Embedder, prompt: str, model: Callable[[], torch.nn.Module]) -> Float[np.ndarray, " d"]:
        digest = digest_of(embed.identity, prompt)
        vector = self.cache.get(f"{embed.name}/text", digest)
        if vector is None:
            (vector,) = clip.embed_texts(model(), [prompt])
            self.cache.put(f"{embed.name}/text", digest, vector)
        return vector

    def _network(self, load: Callable[..., torch.nn.Module], *arguments: Path | str) -> torch.nn.Module:
        if (load, *arguments) not in self._loaded:
            import torch

            torch.set_num_threads(self.threads)
            self._loaded[load, *arguments] = load(*arguments)
        return self._loaded[load, *arguments]


def frame_scores(
    edited: Float[np.ndarray, "n d"], original: Float[np.ndarray, "n d"], texts: Float[np.ndarray, "2 d"]
) -> dict[str, Float[np.ndarray, " n"]]:
    """CLIP-I and CLIP-D of frames.

    Args:
        edited: Embeddings of rendered frames.
        original: Embeddings of the same frames without the edit.
        texts: Embeddings of the source and the edit prompt.

    Returns:
        Values by name of the metric.
    """
    source, edit = texts
    return {
        "clip_i_cos": clip.clip_i(edited, edit),
        "clip_i_score_w2.5": clip.clip_i_score(edited, edit),
        "clip_i_image": clip.clip_i_image(edited, original),
        "clip_d": clip.clip_d(edited, original, edit, source),
    }


def consistency_scores(
    edited: Float[np.ndarray, "n d"], original: Float[np.ndarray, "n d"]
) -> dict[str, Float[np.ndarray, " n-1"]]:
    """CLIP-C of a sequence in three readings, and of the frames without the edit.

    Args:
        edited: Embeddings of rendered frames, in the order of the sequence.
        original: Embeddings of the same frames without the edit.

    Returns:
        Values by name of the metric.
    """
    return {
        "clip_c_adjacent": clip.clip_c_adjacent(edited),
        "clip_c_unedited": clip.clip_c_adjacent(original),
        "clip_c_dir_edit": clip.clip_c_dir_edit(edited, original),
        "clip_c_dir_motion": clip.clip_c_dir_motion(edited, original),
    }


def _files(sequences: list[list]) -> list[Path]:
    """All images of sequences of pairs, rendered frames first: the originals may be known from another level."""
    pairs = [pair for sequence in sequences for pair in sequence]
    return [*(frame.file for frame, _ in pairs), *(original for _, original in pairs)]
