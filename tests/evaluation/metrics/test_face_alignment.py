"""Aligned faces: where the eyes land, and from where a face is seen."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from carigs.capture import Camera, look_at
from evaluation.metrics.face_alignment import CHIP_POINTS, CHIP_SIZE, chip_from_image, face_chip, turn_from_camera

ROOM = np.random.default_rng(0).normal(size=(9, 3))


def similar(scale: float, degrees: float, shift: tuple[float, float]) -> np.ndarray:
    """The points of an aligned face under a similarity of the plane."""
    angle = np.radians(degrees)
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return scale * CHIP_POINTS @ rotation.T + shift


def apply(transform: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ transform[:, :2].T + transform[:, 2]


@given(st.floats(0.1, 10), st.floats(-180, 180), st.tuples(*[st.floats(-1000, 1000)] * 2))
def test_a_face_of_the_templates_shape_lands_on_the_template(scale, degrees, shift):
    points = similar(scale, degrees, shift)
    np.testing.assert_allclose(apply(chip_from_image(points), points), CHIP_POINTS, atol=1e-6)


def test_the_places_are_those_of_dlibs_template():
    # In a chip of 150 pixels with a margin of a quarter of the face, the eyes lie at 46 to 48 pixels.
    assert CHIP_POINTS[:4, 1] == pytest.approx([46.3, 47.9, 46.4, 47.9], abs=0.1)
    assert CHIP_POINTS[:, 0] == pytest.approx([111.0, 89.6, 37.1, 58.4, 74.0], abs=0.1)


def test_other_shapes_land_as_close_as_a_similarity_can_bring_them():
    points = similar(2.0, 20, (100, 50)) + np.random.default_rng(0).normal(size=(5, 2)) * 8
    best = chip_from_image(points)
    a, b = best[:, 0]
    assert best[:, 1] == pytest.approx([-b, a])  # no shear, no reflection

    def error(a, b, x, y):
        return np.square(apply(np.array([[a, -b, x], [b, a, y]]), points) - CHIP_POINTS).sum()

    parameters = np.array([a, b, *best[:, 2]])
    steps = np.concatenate([np.diag([1e-4, 1e-4, 1e-2, 1e-2]), -np.diag([1e-4, 1e-4, 1e-2, 1e-2])])
    assert all(error(*(parameters + step)) > error(*parameters) for step in steps)


@pytest.mark.parametrize("scale", [0.6, 1.0, 3.0])
def test_what_lies_on_the_eyes_in_the_image_lies_on_the_eyes_in_the_chip(scale):
    points = similar(scale, 25, (80, 20))
    y, x = np.mgrid[:600, :600] + 0.5
    for point, expected in zip(points, CHIP_POINTS, strict=True):
        spot = np.exp(-0.5 * ((x - point[0]) ** 2 + (y - point[1]) ** 2) / (2 * scale) ** 2)
        chip = face_chip(np.repeat(spot[:, :, None], 3, axis=2), points, background=0)[:, :, 0].astype(float)
        rows, columns = np.mgrid[:CHIP_SIZE, :CHIP_SIZE] + 0.5
        found = np.array([(chip * columns).sum(), (chip * rows).sum()]) / chip.sum()
        np.testing.assert_allclose(found, expected, atol=0.05)


def test_a_pattern_finer_than_the_chip_becomes_grey():
    stripes = np.ones((900, 900, 3)) * (np.arange(900) % 2)[:, None]
    chip = face_chip(stripes, similar(5.3, 0, (30, 30)))
    np.testing.assert_allclose(chip[20:-20, 20:-20], 127.5, atol=3)


def test_beyond_the_image_the_chip_is_background():
    chip = face_chip(np.zeros((150, 75, 3)), similar(1, 0, (0, 0)), background=0.5)
    assert (chip[:, :74] == 0).all() and (chip[:, 77:] == 128).all()


@given(st.floats(0, 180), st.floats(0, 360), st.tuples(*[st.floats(-3, 3)] * 3))
def test_the_turn_is_the_angle_between_the_face_and_the_camera(degrees, roll, shift):
    # A camera in front of the head; the head turns about an axis across the line of sight, after a roll about +z.
    spin, _ = cv2.Rodrigues(np.array([0, 0, np.radians(roll)]))
    turn, _ = cv2.Rodrigues(np.radians(degrees) * np.array([0.6, 0.8, 0]))
    posed = (ROOM - ROOM.mean(axis=0)) @ (turn @ spin).T + shift
    target = np.array(shift)
    camera = Camera(look_at(target + np.array([0, 0, 2]), target), 500, 500, 50, 50, 100, 100)
    assert turn_from_camera(posed, ROOM, camera) == pytest.approx(degrees, abs=1e-4)


def test_the_chip_is_dlibs():
    dlib = pytest.importorskip("dlib")
    random = np.random.default_rng(0)
    image = cv2.GaussianBlur(random.integers(0, 256, (300, 300, 3)).astype(np.uint8), (0, 0), 3)
    points = np.rint(similar(0.8, -15, (60, 90)))
    parts = [dlib.point(int(x), int(y)) for x, y in points]
    theirs = dlib.get_face_chip(image, dlib.full_object_detection(dlib.rectangle(0, 0, 300, 300), parts), 150, 0.25)
    ours = face_chip(image / 255, points + 0.5)
    assert np.abs(ours.astype(float) - theirs)[5:-5, 5:-5].mean() < 1.5
