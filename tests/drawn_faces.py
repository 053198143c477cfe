"""Faces of three spots, and networks that know where they are, for tests without weights."""

from __future__ import annotations

import numpy as np

from carigs.detection.attention_mesh import FaceInCrop
from carigs.detection.crop import Crop, to_image
from carigs.detection.face_detector import Face
from carigs.detection.mesh_indices import COUNT, LEFT_EYE, MIRRORED, RIGHT_EYE


def template() -> np.ndarray:
    """A symmetric face in units of its size, with x right, y down."""
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (COUNT, 3))
    points[LEFT_EYE[0]], points[RIGHT_EYE[0]] = (-0.3, -0.2, 0), (0.3, -0.2, 0)
    points[10], points[152] = (0, -0.5, 0), (0, 0.5, 0)
    return (points + points[list(MIRRORED)] * (-1, 1, 1)) / 2


FACE = template()


def drawn(faces: list[Crop], shape: tuple[int, int] = (240, 320), pale: Crop | None = None) -> np.ndarray:
    """Soft spots at the left (red), the right (green) and below (blue) of each face; a pale one is another person's."""
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    image = np.zeros((*shape, 3))
    for face in faces:
        spots = np.array([[0.2, 0.3, 0], [0.8, 0.3, 0], [0.5, 0.85, 0]])
        for channel, spot in enumerate(to_image(spots, face, 1)):
            image[..., channel] += 255 * np.exp(-((x - spot[0]) ** 2 + (y - spot[1]) ** 2) / (0.1 * face.size) ** 2)
    if pale is not None:
        centre = to_image(np.array([[0.3, 0.7, 0]]), pale, 1)[0]
        image += 30 * (((x - centre[0]) ** 2 + (y - centre[1]) ** 2) < (0.3 * pale.size) ** 2)[..., None]
    return image.clip(0, 255).round().astype(np.uint8)


def spots(pixels: np.ndarray) -> np.ndarray | None:
    """Where the three spots are; None if one is not seen."""
    weights = np.where(pixels > 40, pixels, 0).astype(float)
    total = weights.sum(axis=(0, 1))
    if (total < 2000).any():
        return None
    y, x = np.mgrid[: pixels.shape[0], : pixels.shape[1]] + 0.5
    return (
        np.stack([(weights * x[..., None]).sum(axis=(0, 1)), (weights * y[..., None]).sum(axis=(0, 1))], 1)
        / total[:, None]
    )


class ColourMesh:
    """Puts the template where the eyes' spots are: in a mirror image, the left one is the red one's mirror image."""

    side = 192

    def __call__(self, crop):
        found = spots(crop)
        if found is None:
            return FaceInCrop(np.zeros((COUNT, 3)), 0.0)
        left, right = sorted(found[:2], key=lambda point: point[0])
        step = (right - left) / 0.6
        turn = np.array([[step[0], -step[1]], [step[1], step[0]]])
        centre = left - turn @ (-0.3, -0.2)
        return FaceInCrop(np.column_stack([FACE[:, :2] @ turn.T + centre, FACE[:, 2] * np.hypot(*step)]), 1.0)


class Told:
    """A detector that is told the faces of each image."""

    def __init__(self, faces: list[list[Crop]]):
        self.faces = iter(faces)

    def __call__(self, image):
        found = []
        for crop in next(self.faces, []):
            eyes = to_image(np.array([[0.2, 0.3, 0], [0.8, 0.3, 0]]), crop, 1)[:, :2]
            half = crop.size * 0.45  # detectors are rough
            box = np.array([crop.x - half, crop.y - half, crop.x + half, crop.y + half])
            found.append(Face(box, np.concatenate([eyes, np.zeros((4, 2))]), 0.9))
        return found


def landmarks(face: Crop) -> np.ndarray:
    return to_image(np.add(FACE, (0.5, 0.5, 0)), face, 1)
