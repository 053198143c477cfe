"""Images are turned until the detectors see upright faces, and only where both agree that these are clearer."""

import numpy as np
import pytest
from drawn_faces import ColourMesh, Told, drawn, landmarks

from carigs.detection import upright
from carigs.detection.crop import Crop
from carigs.detection.face_detector import Face
from carigs.detection.face_networks import FaceNetworks
from carigs.detection.upright import FEWEST, follow_upright, quarter_turns, turned


class Detector:
    """Sees the red pixel as the eyes and the green one as the mouth, and is surer the more upright they are."""

    def __init__(self, tilted_score):
        self.tilted_score, self.calls = tilted_score, 0

    def __call__(self, image):
        self.calls += 1
        if not image.any():
            return []
        eyes, mouth = (np.argwhere(image[..., channel] > 0)[0, ::-1] + 0.5 for channel in (0, 1))
        down = (mouth - eyes)[1] / np.linalg.norm(mouth - eyes)
        points = np.tile(eyes, (6, 1))
        points[3] = mouth
        return [Face(np.array([0.0, 0, 9, 9]), points, self.tilted_score + (0.9 - self.tilted_score) * max(down, 0))]


def face(tilt=0.0):
    """Eyes above a mouth, tilted by degrees."""
    image = np.zeros((60, 80, 3), np.uint8)
    for channel, side in ((0, -1), (1, 1)):
        x, y = 40 - side * 20 * np.sin(np.radians(tilt)), 30 + side * 20 * np.cos(np.radians(tilt))
        image[int(y), int(x), channel] = 255
    return image


def found(images, tilted_score=0.6):
    return quarter_turns(images, FaceNetworks(Detector(tilted_score), Detector(0.0), None))


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize("tilt", [0, 15, -25])
def test_footage_is_turned_until_its_faces_are_upright(turns, tilt):
    assert found([turned(face(tilt), turns)] * FEWEST) == -turns % 4


@pytest.mark.parametrize("tilt", [40, -40, 44])
def test_a_tilted_head_is_left_as_it_is(tilt):
    assert found([face(tilt)] * FEWEST) == 0


def test_what_is_not_clear_is_left_as_it_is():
    upside_down = turned(face(), 2)
    assert found([upside_down] * (FEWEST - 1)) == 0
    assert found([np.zeros_like(upside_down)] * 20) == 0
    sure = FaceNetworks(Detector(0.88), Detector(0.8), None)
    assert quarter_turns([upside_down] * FEWEST, sure) == 0


def test_no_more_images_are_taken_than_are_needed():
    images = iter([turned(face(), 1)] * 100)
    assert found(images) == 3
    assert len([*images]) > 80


@pytest.mark.parametrize("turns", range(4))
def test_landmarks_of_images_that_are_not_upright_lie_in_these_images(monkeypatch, turns):
    """A quarter turn takes x, y to 240 - y, x in an image of 320 x 240 pixels."""
    crop = Crop(150, 120, 90, 0.0)
    monkeypatch.setattr(upright, "quarter_turns", lambda images, networks: -turns % 4)
    lying = turned(drawn([crop]), turns)
    track, found = follow_upright(lambda: [lying] * 2, FaceNetworks(Told([[crop]] * 2), Told([]), ColourMesh()))
    assert found == -turns % 4
    corner = {0: (0, 0), 1: (240, 0), 2: (320, 240), 3: (0, 320)}[turns]
    turn = np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), turns)
    true = landmarks(crop)[:, :2] @ turn.T + corner
    np.testing.assert_allclose(track.landmarks[1, :, :2], true, atol=0.6)
    np.testing.assert_allclose(track.boxes[1], [*true.min(axis=0), *true.max(axis=0)], atol=0.6)
