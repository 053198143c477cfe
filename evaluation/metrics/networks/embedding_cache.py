"""Embeddings on disk: a study embeds each image once, however many variants and levels compare it.

An array is stored under a digest of all that it depends on. The folder can be deleted between runs, and several
processes may use it at once: files appear complete, and equal names have equal contents.
"""

from __future__ import annotations

from hashlib import sha256
from pathlib import Path

import numpy as np
from jaxtyping import Shaped

from carigs.system.files import writing


def digest_of(*parts: str | np.ndarray) -> str:
    """Digest of everything that an embedding depends on.

    Args:
        *parts: Texts and arrays.

    Returns:
        64 hexadecimal digits. Parts that are divided differently have another digest.
    """
    digest = sha256()
    for part in parts:
        content = part.encode() if isinstance(part, str) else np.ascontiguousarray(part).tobytes()
        kind = "text" if isinstance(part, str) else f"{part.dtype} {part.shape}"
        digest.update(f"{kind} {len(content)} ".encode())
        digest.update(content)
    return digest.hexdigest()


class EmbeddingCache:
    """Arrays by digest in a folder."""

    def __init__(self, folder: Path):
        """Use a folder.

        Args:
            folder: The folder; it need not exist.
        """
        self.folder = folder

    def get(self, kind: str, digest: str) -> Shaped[np.ndarray, "..."] | None:
        """Read an array.

        Args:
            kind: Subfolder, such as network and output.
            digest: Of `digest_of`.

        Returns:
            The array; None if it is not there or cannot be read.
        """
        try:
            return np.load(self._file(kind, digest), allow_pickle=False)
        except (OSError, ValueError, EOFError):  # absent or damaged: it is computed again
            return None

    def put(self, kind: str, digest: str, array: Shaped[np.ndarray, "..."]) -> None:
        """Store an array.

        Args:
            kind: Subfolder.
            digest: Of `digest_of`.
            array: The array.
        """
        with writing(self._file(kind, digest)) as part:
            np.save(part, array)

    def _file(self, kind: str, digest: str) -> Path:
        # `writing` lists the folder: 256 of them keep the lists short.
        return self.folder / kind / digest[:2] / f"{digest[2:]}.npy"
