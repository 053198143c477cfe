"""A coarse matte of the person in an image, by the network `selfie_segmentation` of the weights `mediapipe_face`."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

from carigs.detection.face_networks import network_file
from carigs.detection.network import Network

SIDE = 256
"""Pixels of the network's input and output."""


class PersonSegmenter:
    """Finds what belongs to people. The whole image is squeezed into the network's square, as MediaPipe does.

    Args:
        content: The network's file.
    """

    def __init__(self, content: bytes) -> None:
        self._network = Network(content)

    def __call__(self, image: UInt8[np.ndarray, "h w 3"]) -> Float32[np.ndarray, "s s"]:
        """Find the people in an image.

        Args:
            image: sRGB.

        Returns:
            Coarse matte in [0, 1] of 256 x 256 pixels that cover the image.
        """
        small = cv2.resize(image, (SIDE, SIDE), interpolation=cv2.INTER_AREA)
        (matte,) = self._network(small[None].astype(np.float32) / 255)
        return np.ascontiguousarray(matte.reshape(SIDE, SIDE).clip(0, 1))


def load_person_segmenter(folder: str | Path | None = None) -> PersonSegmenter:
    """Load the network.

    Args:
        folder: Folder of weights that is searched first.

    Returns:
        The network.

    Raises:
        CarigsError: If ai-edge-litert is not installed.
        WeightsMissing: If the weights are nowhere; names the command that fetches them.
        InputError: If the file is damaged, or there is no such folder.
    """
    return PersonSegmenter(network_file("selfie_segmentation", folder))
