"""A face is followed, by networks that know where it is because it is drawn in three colours."""

import math

import numpy as np
import pytest

from carigs.detection.attention_mesh import FaceInCrop
from carigs.detection.crop import Crop, to_image
from carigs.detection.face_detector import Face
from carigs.detection.face_networks import FaceNetworks
from carigs.detection.face_track import collect
from carigs.detection.face_tracking import follow_face
from carigs.detection.mesh_indices import COUNT, LEFT_EYE, MIRRORED, RIGHT_EYE


def template() -> np.ndarray:
    """A symmetric face in units of its size, with x right, y down."""
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (COUNT, 3))
    points[LEFT_EYE[0]], points[RIGHT_EYE[0]] = (-0.3, -0.2, 0), (0.3, -0.2, 0)
    points[10], points[152] = (0, -0.5, 0), (0, 0.5, 0)
    return (points + points[list(MIRRORED)] * (-1, 1, 1)) / 2


FACE = template()


def drawn(faces: list[Crop], shape: tuple[int, int] = (240, 320)) -> np.ndarray:
    """Soft spots at the left (red), the right (green) and below (blue) of each face."""
    y, x = np.mgrid[: shape[0], : shape[1]] + 0.5
    image = np.zeros((*shape, 3))
    for face in faces:
        spots = np.array([[0.2, 0.3, 0], [0.8, 0.3, 0], [0.5, 0.85, 0]])
        for channel, spot in enumerate(to_image(spots, face, 1)):
            image[..., channel] += 255 * np.exp(-((x - spot[0]) ** 2 + (y - spot[1]) ** 2) / (0.1 * face.size) ** 2)
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


def followed(images, told, far=()):
    return collect(follow_face(iter(images), FaceNetworks(Told(told), Told(list(far)), ColourMesh())))


def landmarks(face: Crop) -> np.ndarray:
    return to_image(np.add(FACE, (0.5, 0.5, 0)), face, 1)


@pytest.mark.parametrize("angle", [0, 0.4, -0.7])
def test_landmarks_are_where_the_face_is_however_it_is_turned(angle):
    face = Crop(150, 120, 90, angle)
    track = followed([drawn([face])], [[face]])
    assert np.abs(track.landmarks[0] - landmarks(face)).max() < 0.6
    assert track.faces.tolist() == [1] and not track.notes()


def test_the_largest_face_is_chosen_and_then_followed():
    one = [Crop(90, 120, 80, 0.0)] * 3
    other = [Crop(240, 120, size, 0.0) for size in (50, 75, 95)]
    images = [drawn([a, b]) for a, b in zip(one, other, strict=True)]
    track = followed(images, [[b, a] for a, b in zip(one, other, strict=True)])
    for found in track.landmarks:
        assert np.abs(found - landmarks(one[0])).max() < 1
    assert track.notes() == ["several faces, of which one is followed: 3 of 3 images (0-2)"]


def test_a_face_that_the_detector_loses_is_followed_from_where_it_was():
    faces = [Crop(100 + 6 * i, 120, 90, 0.05 * i) for i in range(5)]
    track = followed([drawn([face]) for face in faces], [[faces[0]]])
    for found, face in zip(track.landmarks, faces, strict=True):
        assert np.abs(found - landmarks(face)).max() < 0.8
    assert not track.notes()


def test_images_without_a_face_and_jumps_are_noted():
    first, second = Crop(80, 100, 80, 0.0), Crop(240, 140, 80, 0.0)
    nothing = drawn([])
    images = [nothing, drawn([first]), nothing, nothing, drawn([second])]
    track = followed(images, [[], [first], [], [], [second]])
    assert np.isnan(track.landmarks[[0, 2, 3]]).all() and track.presence.tolist() == [0, 1, 0, 0, 1]
    assert track.notes() == [
        "no face: 3 of 5 images (0, 2-3)",
        "the face jumps, as in a cut or to another person: 1 of 5 images (4)",
    ]


def test_the_second_detector_is_asked_where_the_first_finds_nothing():
    face = Crop(150, 120, 60, 0.0)
    assert followed([drawn([face])], [[]], [[face]]).found.tolist() == [True]


def test_a_detection_that_is_no_face_is_none():
    assert followed([drawn([])], [[Crop(100, 100, 50, 0.0)]]).found.tolist() == [False]


def test_one_image_at_a_time_is_taken():
    taken = []

    def images():
        for i in range(3):
            taken.append(i)
            yield drawn([Crop(150, 120, 90, 0.0)])

    results = follow_face(images(), FaceNetworks(Told([[Crop(150, 120, 90, 0.0)]] * 3), Told([]), ColourMesh()))
    assert next(results).face is not None and taken == [0]


def test_no_images_are_an_empty_track():
    track = collect([])
    assert track.landmarks.shape == (0, COUNT, 3) and track.notes() == [] and not math.fsum(track.presence)
