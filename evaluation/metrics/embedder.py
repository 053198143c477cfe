"""Embeddings of image files by a network, each computed once."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float, Shaped
from rich.progress import track

from carigs.capture.images import read_rgb8
from evaluation.metrics.embedding_cache import EmbeddingCache, digest_of
from evaluation.metrics.preprocessing import Preprocessing

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
    _digests: dict[Path, str] = field(default_factory=dict)

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
        digests = [self._digest(file) for file in files]
        found = {digest: self.cache.get(f"{self.name}/{output}", digest) for digest in dict.fromkeys(digests)}
        missing = {digest: file for digest, file in zip(digests, files, strict=True) if found[digest] is None}
        for batch in _batches(list(missing.values())):
            for file, vector in zip(batch, self._embed(batch)[output], strict=True):
                found[self._digest(file)] = vector
        vectors = np.stack([found[digest] for digest in digests]).astype(np.float64)
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

    def _digest(self, file: Path) -> str:
        if file not in self._digests:
            self._digests[file] = digest_of(self.identity, repr(self.prepare), read_rgb8(file, self.background))
        return self._digests[file]

    def _embed(self, files: Sequence[Path]) -> dict[str, Shaped[np.ndarray, "n d"]]:
        import torch

        with torch.inference_mode():
            images = torch.stack([self.prepare(read_rgb8(file, self.background)) for file in files])
            outputs = {name: vectors.numpy() for name, vectors in self.forward(images).items()}
        for name, vectors in outputs.items():
            for file, vector in zip(files, vectors, strict=True):
                self.cache.put(f"{self.name}/{name}", self._digest(file), vector)
        return outputs


def _batches(files: Sequence[Path]) -> list[Sequence[Path]]:
    return [files[i : i + BATCH] for i in range(0, len(files), BATCH)]
