"""The network `face_landmark_with_attention` of MediaPipe: 478 landmarks of a face in a crop of 192 x 192 pixels.

A first part finds 468 landmarks and features of 48 x 48 cells. Around lips and eyes, features of 16 x 16 cells are
sampled from those, turned as the landmarks lie, and a second part finds finer landmarks in them (Grishchenko et al.
2020, Attention Mesh). The sampling is done by three operations of MediaPipe that the runtime lacks; they are written
here, and the graph is cut at them.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from jaxtyping import Float, Float32, UInt8

from carigs.detection.graph_cut import custom_operations, cut, read_graph
from carigs.detection.mesh_indices import (
    COUNT,
    LEFT_EYE,
    LEFT_EYE_REGION,
    LEFT_IRIS,
    LIPS,
    RIGHT_EYE,
    RIGHT_EYE_REGION,
    RIGHT_IRIS,
)
from carigs.detection.network import Network

SIDE = 192
"""Width and height of the network's input in pixels."""
FEATURE_STRIDE = 4
"""Pixels for each cell of the features."""
CELLS, MARGIN = 16, 1.5
"""Width and height of the part for a region in cells, and its size in those of the box around its landmarks."""
_CENTRES = np.stack(np.meshgrid(np.arange(CELLS), np.arange(CELLS))).reshape(2, -1) + 0.5
"""x and y of the centres of these cells."""


class FaceInCrop(NamedTuple):
    """What the network finds."""

    points: Float[np.ndarray, "p 3"]
    """x, y in pixels of the crop, and z in the same unit, smaller nearer to the camera."""
    presence: float
    """Probability that there is a face."""


class _Region(NamedTuple):
    """A part of the face that is looked at more closely."""

    points: tuple[int, ...]
    left: int
    """The line from this landmark to `right` becomes horizontal."""
    right: int


REGIONS = (
    _Region(LIPS, 61, 291),
    _Region(LEFT_EYE_REGION, 33, 133),
    _Region(RIGHT_EYE_REGION, 362, 263),
)
"""As stated in the operations `Landmarks2TransformMatrix` of the graph, in its order."""
REFINED = ((LIPS, 0), (LEFT_EYE_REGION, 1), (LEFT_IRIS, 1), (RIGHT_EYE_REGION, 2), (RIGHT_IRIS, 2))
"""Outputs of the second part: their landmarks, and the number of the region that they are in."""


class AttentionMesh:
    """The network.

    Args:
        content: The file `face_landmark_with_attention.tflite`.
    """

    side = SIDE

    def __init__(self, content: bytes) -> None:
        graph = read_graph(content)
        samples = custom_operations(graph, "TransformTensorBilinear")
        refined = [operation.inputs[0] for operation in custom_operations(graph, "TransformLandmarks")]
        mesh, presence = graph.subgraphs[0].outputs[0], graph.subgraphs[0].outputs[-1]
        features = samples[0].inputs[0]
        self._trunk = Network(cut(graph, graph.subgraphs[0].inputs, [mesh, presence, features]))
        self._heads = Network(cut(graph, [operation.outputs[0] for operation in samples], refined))

    def __call__(self, crop: UInt8[np.ndarray, "s s 3"]) -> FaceInCrop:
        """Find the landmarks of the face that fills a crop.

        Args:
            crop: RGB values.

        Returns:
            The landmarks; meaningless if there is no face.
        """
        mesh, presence, features = self._trunk(crop[None].astype(np.float32) / 255)
        points = np.zeros((COUNT, 3))
        points[: mesh.size // 3] = mesh.reshape(-1, 3)
        matrices = [features_from_region(points[:, :2] / FEATURE_STRIDE, region) for region in REGIONS]
        refined = self._heads(*(sampled(features[0], matrix)[None] for matrix in matrices))
        for (indices, region), found in zip(REFINED, refined, strict=True):
            matrix = matrices[region]
            points[list(indices), :2] = found[0] @ matrix[:, :2].T + FEATURE_STRIDE * matrix[:, 2]
        for iris, eye in ((LEFT_IRIS, LEFT_EYE), (RIGHT_IRIS, RIGHT_EYE)):
            points[list(iris), 2] = points[list(eye), 2].mean()
        return FaceInCrop(points, 1 / (1 + float(np.exp(-presence.item()))))


def features_from_region(points: Float[np.ndarray, "p 2"], region: _Region) -> Float[np.ndarray, "2 3"]:
    """The affine map from cells of a region to cells of the features (`Landmarks2TransformMatrix`, version 2).

    Args:
        points: Landmarks in cells of the features.
        region: The region.

    Returns:
        A rotation by the direction of the region's line, and scales so that the box around its landmarks in that
        direction, with its margin, has `CELLS` x `CELLS` cells.
    """
    direction = points[region.right] - points[region.left]
    cos, sin = direction / max(np.linalg.norm(direction), 1e-9)
    image_from_upright = np.array([[cos, -sin], [sin, cos]])
    upright = points[list(region.points)] @ image_from_upright
    low, high = upright.min(axis=0), upright.max(axis=0)
    linear = image_from_upright * (MARGIN * (high - low) / CELLS)
    return np.column_stack([linear, image_from_upright @ (low + high) / 2 - linear @ (CELLS / 2, CELLS / 2)])


def sampled(
    features: Float32[np.ndarray, "h w c"], matrix: Float[np.ndarray, "2 3"]
) -> Float32[np.ndarray, "cells cells c"]:
    """Sample features bilinearly, 0 outside (`TransformTensorBilinear`, version 2).

    Args:
        features: The features.
        matrix: Affine map from cells of the result to cells of the features, their centres at +0.5.

    Returns:
        `CELLS` x `CELLS` of them.
    """
    height, width = features.shape[:2]
    x, y = matrix[:, :2] @ _CENTRES + matrix[:, 2:] - 0.5
    inside = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    left, top = np.clip(np.floor(x), 0, width - 2).astype(int), np.clip(np.floor(y), 0, height - 2).astype(int)
    right, lower = x - left, y - top
    first, cells = top * width + left, features.reshape(height * width, -1)
    total = np.zeros((CELLS * CELLS, cells.shape[1]), np.float32)
    for step, weight in (
        (0, (1 - right) * (1 - lower)),
        (1, right * (1 - lower)),
        (width, (1 - right) * lower),
        (width + 1, right * lower),
    ):
        total += np.where(inside, weight, 0).astype(np.float32)[:, None] * cells[first + step]
    return total.reshape(CELLS, CELLS, -1)
