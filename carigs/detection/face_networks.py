"""The networks that find a face and its landmarks, from the weights `mediapipe_face`."""

from __future__ import annotations

from functools import partial
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from jaxtyping import UInt8

from carigs.detection.attention_mesh import AttentionMesh, FaceInCrop
from carigs.detection.face_detector import FULL_RANGE, SHORT_RANGE, Face, FaceDetector
from carigs.detection.network import RUNTIME
from carigs.errors import InputError
from carigs.readers.limits import read_bytes
from carigs.system.extras import need
from carigs.weights.registry import registered
from carigs.weights.search import find_weights

WEIGHTS = "mediapipe_face"
MAX_BYTES = 64 << 20


class Mesh(Protocol):
    """A network that finds landmarks in a crop."""

    side: int

    def __call__(self, crop: UInt8[np.ndarray, "s s 3"]) -> FaceInCrop:
        """Find the landmarks of the face that fills a crop of `side` x `side` pixels."""


class Detector(Protocol):
    """A network that finds faces."""

    def __call__(self, image: UInt8[np.ndarray, "h w 3"]) -> list[Face]:
        """Find the faces of an image."""


class FaceNetworks(NamedTuple):
    """What finding and following a face takes."""

    near: Detector
    """For faces that fill a good part of the image."""
    far: Detector
    """For smaller ones, where the other finds none."""
    mesh: Mesh


def network_file(name: str, folder: str | Path | None) -> bytes:
    """Read one of the networks from the weights `mediapipe_face`.

    Args:
        name: Its name, without the suffix.
        folder: Folder of weights that is searched first.

    Returns:
        The file.

    Raises:
        CarigsError: If ai-edge-litert is not installed.
        WeightsMissing: If the weights are nowhere; names the command that fetches them.
        InputError: If a file is damaged, or there is no such folder.
    """
    need(RUNTIME)
    if folder is not None and not Path(folder).expanduser().is_dir():
        raise InputError("no such folder of weights", file=folder)
    root = find_weights(registered(WEIGHTS), folder)
    return read_bytes(root / f"{name}.tflite", MAX_BYTES, "file of weights")


def load_face_networks(folder: str | Path | None = None) -> FaceNetworks:
    """Load the networks. They use one thread; each process loads its own.

    Args:
        folder: Folder of weights that is searched first.

    Returns:
        The networks.

    Raises:
        CarigsError: If ai-edge-litert is not installed.
        WeightsMissing: If the weights are nowhere; names the command that fetches them.
        InputError: If a file is damaged, or there is no such folder.
    """
    content = partial(network_file, folder=folder)
    return FaceNetworks(
        FaceDetector(content("face_detection_short_range"), SHORT_RANGE),
        FaceDetector(content("face_detection_full_range_sparse"), FULL_RANGE),
        AttentionMesh(content("face_landmark_with_attention")),
    )
