"""Boxes and six points of the faces in an image: the single-shot detectors of MediaPipe (Bazarevsky et al. 2019)."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from carigs.detection.crop import Crop, image_from_crop, sample
from carigs.detection.network import Network

EYES, MOUTH = (0, 1), 3
"""Of the six points: the eyes at the left and at the right of the image, and the middle of the mouth."""
SAME_FACE = 0.3
"""Overlap (intersection over union) of boxes from which they are of one face."""
LARGEST_LOGIT = 100.0


class DetectorKind(NamedTuple):
    """What differs between the detectors."""

    side: int
    """Width and height of the network's input in pixels."""
    grids: tuple[tuple[int, int], ...]
    """Cells along a side, and boxes in each of them."""
    least_score: float


SHORT_RANGE = DetectorKind(128, ((16, 2), (8, 6)), 0.5)
"""Faces from about an eighth of the longer side of the image on."""
FULL_RANGE = DetectorKind(192, ((48, 1),), 0.6)
"""Faces from about a sixteenth of the longer side on."""


class Face(NamedTuple):
    """A face that was found."""

    box: Float[np.ndarray, "4"]
    """Left, top, right, bottom in pixels of the image."""
    points: Float[np.ndarray, "6 2"]
    """Eyes, tip of the nose, mouth, ears."""
    score: float


class FaceDetector:
    """A detector.

    Args:
        content: The file `face_detection_short_range.tflite` or `face_detection_full_range_sparse.tflite`.
        kind: Which of them it is.
    """

    def __init__(self, content: bytes, kind: DetectorKind) -> None:
        self._network, self._kind = Network(content), kind
        self._anchors = anchors(kind)

    def __call__(self, image: UInt8[np.ndarray, "h w 3"]) -> list[Face]:
        """Find the faces of an image.

        Args:
            image: RGB values.

        Returns:
            The faces, the likeliest first.
        """
        height, width = image.shape[:2]
        whole, side = Crop(width / 2, height / 2, max(width, height), 0.0), self._kind.side
        pixels = sample(image, whole, side, border=cv2.BORDER_CONSTANT)
        values, logits = self._network(pixels[None].astype(np.float32) / 127.5 - 1)
        scores = 1 / (1 + np.exp(-np.clip(logits[0, :, 0].astype(np.float64), -LARGEST_LOGIT, LARGEST_LOGIT)))
        likely = scores >= self._kind.least_score
        corners = decoded(values[0][likely].astype(np.float64), self._anchors[likely], side)
        corners, scores = suppressed(corners, scores[likely])
        matrix = image_from_crop(whole, side)
        corners = corners @ matrix[:, :2].T + matrix[:, 2]
        return [Face(c[:2].ravel(), c[2:], float(s)) for c, s in zip(corners, scores, strict=True)]


def anchors(kind: DetectorKind) -> Float[np.ndarray, "n 2"]:
    """Centres of the cells, one for each box.

    Args:
        kind: The detector.

    Returns:
        x, y in sizes of the input, row after row of each grid.
    """
    centres = []
    for cells, boxes in kind.grids:
        along = (np.arange(cells) + 0.5) / cells
        grid = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
        centres.append(np.repeat(grid, boxes, axis=0))
    return np.concatenate(centres)


def decoded(
    values: Float[np.ndarray, "n 16"], centres: Float[np.ndarray, "n 2"], side: int
) -> Float[np.ndarray, "n 8 2"]:
    """Points of the input from the network's values.

    Args:
        values: x, y of the box's centre from that of the cell, width, height, and six points as x, y; in pixels.
        centres: Centres of the cells in sizes of the input.
        side: Width and height of the input in pixels.

    Returns:
        Upper left and lower right corner of the box, and the six points, in pixels of the input.
    """
    points = values.reshape(-1, 8, 2).copy()
    half = points[:, 1] / 2
    points[:, 0], points[:, 1] = points[:, 0] - half, points[:, 0] + half
    return points + side * centres[:, None]


def suppressed(
    corners: Float[np.ndarray, "n p 2"], scores: Float[np.ndarray, " n"]
) -> tuple[Float[np.ndarray, "m p 2"], Float[np.ndarray, " m"]]:
    """One box for each face: the mean of those that overlap the likeliest one, weighted by their scores.

    Args:
        corners: Two corners of each box, and points that are averaged with them.
        scores: Probabilities.

    Returns:
        Corners and points of each face, and the highest score, in the order of the scores.
    """
    means, best = [], []
    left = np.argsort(-scores, kind="stable")
    while len(left):
        near = overlaps(corners[left[0], :2].ravel(), corners[left, :2].reshape(-1, 4)) > SAME_FACE
        near[0] = True
        means.append(np.average(corners[left[near]], axis=0, weights=scores[left[near]]))
        best.append(scores[left[0]])
        left = left[~near]
    return np.array(means).reshape(-1, *corners.shape[1:]), np.array(best)


def overlaps(box: Float[np.ndarray, "4"], boxes: Float[np.ndarray, "n 4"]) -> Float[np.ndarray, " n"]:
    """Intersection over union of a box with others.

    Args:
        box: Left, top, right, bottom.
        boxes: The others.

    Returns:
        0 (apart) to 1 (the same).
    """
    low, high = np.maximum(boxes[:, :2], box[:2]), np.minimum(boxes[:, 2:], box[2:])
    shared = np.prod(np.clip(high - low, 0, None), axis=1)
    areas = np.prod(np.clip(boxes[:, 2:] - boxes[:, :2], 0, None), axis=1)
    union = areas + np.prod(np.clip(box[2:] - box[:2], 0, None)) - shared
    return shared / np.maximum(union, 1e-12)
