"""Semantic labels of the frames, from files: pixels whose class is not the head itself, such as hair or a collar."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Int

from carigs.errors import InputError
from carigs.readers.images import read_pixels

MIN_VIEWS = 3
"""Least number of labelled views that show a triangle."""
COVERED_SHARE = 0.5
"""Of the pixels of a triangle over all labelled views, from which on it is covered."""


def read_covering(file: Path, classes: Sequence[int], size: tuple[int, int]) -> Bool[np.ndarray, "h w"] | None:
    """Read which pixels of a frame show what covers the head.

    Args:
        file: Grey image with the class of each pixel.
        classes: Values of the classes that cover.
        size: Height and width of the frame. Labels of another resolution are scaled if the proportions agree.

    Returns:
        The pixels; None if there is no such file.

    Raises:
        InputError: If the file is not an 8-bit grey image, or has other proportions than the frame.
    """
    if not file.exists():
        return None
    labels = read_pixels(file)
    if labels.dtype != np.uint8 or labels.ndim != 2:
        raise InputError("expected an 8-bit grey image with the class of each pixel, no colours", file=file)
    if abs(labels.shape[0] * size[1] - labels.shape[1] * size[0]) > max(*size, *labels.shape):
        found, expected = (f"{w} x {h}" for h, w in (labels.shape, size))
        raise InputError(f"{found} pixels; its frame has {expected}", file=file)
    rows, columns = ((np.arange(n) + 0.5) * m / n for n, m in zip(size, labels.shape, strict=True))
    return np.isin(labels, classes)[rows.astype(int)[:, None], columns.astype(int)]


def labelled_as_covered(
    labels: Iterable[tuple[Int[np.ndarray, "h w"], Bool[np.ndarray, "h w"]]], num_faces: int
) -> Bool[np.ndarray, " f"]:
    """Find the triangles that most labels call covered.

    Args:
        labels: Per labelled view the nearest triangle of each pixel, -1 where there is none, and the pixels that show
            what covers the head.
        num_faces: Number of triangles.

    Returns:
        True for triangles that enough views show, and that are covered in most of their pixels.
    """
    total, inside, views = (np.zeros(num_faces) for _ in range(3))
    for face, covering in labels:
        count = _count(face, num_faces)
        total += count
        inside += _count(np.where(covering, face, -1), num_faces)
        views += count > 0
    return (views >= MIN_VIEWS) & (inside > COVERED_SHARE * total)


def _count(face: Int[np.ndarray, "h w"], num_faces: int) -> Float[np.ndarray, " f"]:
    return np.bincount(face[face >= 0], minlength=num_faces).astype(float)
