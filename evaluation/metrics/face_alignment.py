"""Faces cut out of images as dlib's face recognition expects them, aligned by landmarks of the posed mesh.

The corners of the eyes and the base of the nose come to the same places in every aligned face. They are projected from
the mesh: no face has to be detected, and no landmark network is needed.
"""

from __future__ import annotations

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from carigs.capture import Camera
from carigs.mesh.rigid_alignment import rigid_alignment

ALIGNED = (45, 42, 36, 39, 33)
"""The aligned points as iBUG landmarks: outer and inner corner of the left eye, of the right eye, base of the nose."""
RIGID = (*range(27, 36), 36, 39, 42, 45)
"""Landmarks that expressions hardly move: the nose and the corners of the eyes."""
TEMPLATE = np.array(
    [
        [0.8595674595992, 0.2134981538014],
        [0.6460604764104, 0.2289674387677],
        [0.1205750620789, 0.2137274526848],
        [0.3340850613712, 0.2290642403242],
        [0.4901123135679, 0.6277975316475],
    ]
)
"""Places (x, y) of the aligned points in a face of size 1, from dlib's `get_face_chip_details`."""
CHIP_SIZE, PADDING = 150, 0.25  # what dlib's network was trained with
CHIP_POINTS = (TEMPLATE + PADDING) / (1 + 2 * PADDING) * CHIP_SIZE
"""Places of the aligned points in the chip in pixels."""


def chip_from_image(points: Float[np.ndarray, "5 2"]) -> Float[np.ndarray, "2 3"]:
    """Similarity transform that brings the points of a face to their places in the chip (least squares, Umeyama 1991).

    Args:
        points: Image positions of the `ALIGNED` landmarks in pixels.

    Returns:
        Matrix [s R | t].
    """
    # With complex numbers, a similarity of the plane is a linear function w = a z + b.
    source, target = (p[:, 0] + 1j * p[:, 1] for p in (points, CHIP_POINTS))
    centred = source - source.mean()
    a = np.vdot(centred, target) / np.vdot(centred, centred)
    b = target.mean() - a * source.mean()
    return np.array([[a.real, -a.imag, b.real], [a.imag, a.real, b.imag]])


def face_chip(
    image: Float[np.ndarray, "h w 3"], points: Float[np.ndarray, "5 2"], background: float = 1.0
) -> UInt8[np.ndarray, "150 150 3"]:
    """Cut an aligned face out of an image.

    Args:
        image: Image with values in [0, 1].
        points: Image positions of the `ALIGNED` landmarks in pixels, with pixel centres at +0.5.
        background: Grey value beyond the image.

    Returns:
        Aligned face with values from 0 to 255.
    """
    transform = chip_from_image(points)
    scale = float(np.hypot(*transform[:, 0]))
    image = np.ascontiguousarray(image, np.float32)
    if scale < 1:  # against aliasing
        image = cv2.GaussianBlur(image, (0, 0), 0.5 * np.sqrt(scale**-2 - 1), borderType=cv2.BORDER_REPLICATE)
    transform[:, 2] += transform[:, :2] @ [0.5, 0.5] - 0.5  # OpenCV counts from the centre of the first pixel
    chip = cv2.warpAffine(image, transform, (CHIP_SIZE, CHIP_SIZE), borderValue=(background,) * 3)
    return np.rint(255 * chip.clip(0, 1)).astype(np.uint8)


def turn_from_camera(posed: Float[np.ndarray, "n 3"], rest: Float[np.ndarray, "n 3"], camera: Camera) -> float:
    """Angle between the direction of a face and the direction to the camera.

    Args:
        posed: Points of the head that move rigidly, in world coordinates.
        rest: The same points of the neutral head, which faces +z.
        camera: The camera.

    Returns:
        Degrees: 0 for a face that looks into the camera, 180 for the back of the head.
    """
    world_from_rest, _ = rigid_alignment(rest, posed)
    direction, to_camera = world_from_rest[:, 2], camera.centre - posed.mean(axis=0)
    cosine = direction @ to_camera / np.linalg.norm(to_camera)
    return float(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
