"""Embeddings of image files by a network, each computed once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Shaped, UInt8
from rich.progress import track

from carigs.capture.images import read_rgb8
from evaluation.metrics.networks.embedding_cache import EmbeddingCache, digest_of
from evaluation.metrics.networks.preprocessing import Preprocessing

if TYPE_CHECKING:
    import torch

BATCH = 8


@dataclass
class Embedder:
    """A network with its preprocessing, and a cache of what it has embedded."""

    name: str
    """Of the network; a subfolder of the cache."""
    identity: str
    """Digest of the network's weights and code: what differs in it is not taken from the cache."""
    forward: Callable[[torch.Tensor], Mapping[str, torch.Tensor]]
    """The network, from preprocessed images (n, 3, s, s) to its outputs by name (n, d). It is called for images that
    are not in the cache, and can load itself then."""
    prepare: Preprocessing
    cache: EmbeddingCache
    background: float = 1.0
    """Grey value in [0, 1] on which images with an alpha channel are composited."""
    pixels: dict[Path, str] = field(default_factory=dict)
    """Digest of the pixels of each known image on the background; networks of the same images can share it."""

    def __call__(self, files: Sequence[Path], output: str) -> Float[np.ndarray, "n d"]:
        """Embed image files.

        Args:
            files: Images, at least one.
            output: One of the network's outputs. A pass of the network keeps all of them.

        Returns:
            Normalised float64 embeddings, in the order of the files.

        Raises:
            InputError: A file is missing or not an image.
        """
        found: dict[Path, Shaped[np.ndarray, " d"]] = {}
        for batch in _batches(list(dict.fromkeys(files))):
            found |= self._batch(batch, output)
        vectors = np.stack([found[file] for file in files]).astype(np.float64)
        return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)

    def fill(self, files: Sequence[Path], output: str) -> None:
        """Embed image files with a progress bar, so that later calls find them in the cache.

        Args:
            files: Images.
            output: One of the network's outputs.
        """
        batches = _batches(list(dict.fromkeys(files)))
        for batch in track(batches, description=f"embedding ({self.name})", disable=len(batches) < 10):
            self(batch, output)

    def _batch(self, files: Sequence[Path], output: str) -> dict[Path, Shaped[np.ndarray, " d"]]:
        """Embeddings of different files. An image is decoded once, for its digest and for the network."""
        images: dict[Path, UInt8[np.ndarray, "h w 3"]] = {}

        def image(file: Path) -> UInt8[np.ndarray, "h w 3"]:
            if file not in images:
                images[file] = read_rgb8(file, self.background)
            return images[file]

        for file in files:
            if file not in self.pixels:
                self.pixels[file] = digest_of(image(file))
        keys = {file: digest_of(self.identity, repr(self.prepare), self.pixels[file]) for file in files}
        found = {key: self.cache.get(f"{self.name}/{output}", key) for key in dict.fromkeys(keys.values())}
        missing = {key: file for file, key in keys.items() if found[key] is None}
        if missing:
            embedded = self._embed([image(file) for file in missing.values()])
            for name, vectors in embedded.items():
                for key, vector in zip(missing, vectors, strict=True):
                    self.cache.put(f"{self.name}/{name}", key, vector)
            found |= zip(missing, embedded[output], strict=True)
        return {file: found[key] for file, key in keys.items()}

    def _embed(self, images: Sequence[UInt8[np.ndarray, "h w 3"]]) -> dict[str, Shaped[np.ndarray, "n d"]]:
        import torch

        with torch.inference_mode():
            outputs = self.forward(torch.stack([self.prepare(image) for image in images]))
            return {name: vectors.numpy() for name, vectors in outputs.items()}


def _batches(files: Sequence[Path]) -> list[Sequence[Path]]:
    return [files[i : i + BATCH] for i in range(0, len(files), BATCH)]
