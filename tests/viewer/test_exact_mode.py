"""Cameras of the browser, parts of images, and the resolution while something moves."""

import math

import numpy as np
import pytest
from avatars import CAMERA, ball_avatar

from carigs.capture import Camera, look_at
from carigs.library import HeadAvatar
from carigs.viewer.controls import controls_of
from carigs.viewer.exact_mode import (
    Resolution,
    View,
    cropped,
    exact_image,
    fitted,
    full_height,
    page_pose,
    split_image,
)
from carigs.viewer.scene import HeadScene
from carigs.viewer.splat_records import SCENE_SCALE
from carigs.viewer.state import State

WINDOW = View((0.0, 1.0, 0.0, 0.0), (0.0, 0.0, 10.0), 0.6, 401, 275)


def test_the_page_shows_a_camera_and_reports_the_same():
    camera = Camera(look_at(np.array([0.3, 0.2, 0.8]), np.zeros(3)), 300, 300, 100, 75, 200, 150)
    wxyz, position, fov = page_pose(camera)
    back = View(wxyz, position, fov, 200, 150).camera()
    np.testing.assert_allclose(back.camera_from_world, camera.camera_from_world, atol=1e-12)
    np.testing.assert_allclose(back.intrinsics, camera.intrinsics)


def test_the_axis_of_the_view_is_the_middle_of_the_image_at_every_height():
    for height in (275, 96, 33):
        camera = WINDOW.camera(height)
        centre = np.array(WINDOW.position) / SCENE_SCALE
        top = centre + np.array([0, math.tan(0.3), -1])
        (middle, edge), depth = camera.project(np.stack([centre - [0, 0, 1], top]))
        np.testing.assert_allclose(middle, [camera.width / 2, camera.height / 2])
        np.testing.assert_allclose(edge, [camera.width / 2, 0], atol=1e-9)
        assert (depth > 0).all()
        right = centre + np.array([math.tan(0.3) * 401 / 275, 0, -1])
        np.testing.assert_allclose(camera.project(right[None])[0][0, 0], camera.width)


@pytest.mark.parametrize(
    "change",
    [
        {"fov": math.nan}, {"fov": 0.0}, {"width": 0}, {"height": 10**9}, {"width": "wide"}, {"width": 16000},
        {"position": (0, math.inf, 0)}, {"position": (0, 0)}, {"position": (1e300, 0, 0)},
        {"wxyz": (0, 0, 0, 0)}, {"wxyz": None},
    ],
)  # fmt: skip
def test_cameras_that_cannot_exist(change):
    assert WINDOW.is_possible
    assert not WINDOW._replace(**change).is_possible


def test_columns_of_an_image_are_the_image():
    avatar = HeadAvatar(ball_avatar())
    surfels = HeadScene(avatar).surfels(State(controls_of(avatar)).values, CAMERA.centre)
    whole = exact_image(surfels, CAMERA, 1.0)
    parts = [exact_image(surfels, cropped(CAMERA, a, b), 1.0) for a, b in ((0, 20), (20, 64))]
    np.testing.assert_allclose(np.concatenate(parts, axis=1), whole, atol=2e-5)
    split = split_image(*parts)
    np.testing.assert_allclose(np.delete(split, [19, 20], axis=1), np.delete(whole, [19, 20], axis=1), atol=2e-5)


@pytest.mark.parametrize(("width", "height"), [(400, 100), (64, 300), (128, 128)])
def test_a_camera_of_the_capture_lies_in_the_middle_of_the_window(width, height):
    camera = fitted(CAMERA, width, height)
    corners = np.array([[0.0, 0.0], [64.0, 64.0]])
    rays = np.column_stack([(corners - 32) / 150, np.ones(2)]) @ CAMERA.camera_from_world[:3, :3] + CAMERA.centre
    side = min(width, height)
    expected = 0.5 * np.array([[width - side, height - side], [width + side, height + side]])
    np.testing.assert_allclose(camera.project(rays)[0], expected, atol=1e-9)


@pytest.mark.parametrize("seconds_per_pixel", [1e-8, 2e-7, 1e-5])
def test_moving_images_take_as_long_as_they_may(seconds_per_pixel):
    resolution, window = Resolution(0.04), WINDOW._replace(width=1920, height=1080)
    for _ in range(30):
        height = resolution.height(window)
        width = round(height * 1920 / 1080)
        resolution.measured(0.01 + seconds_per_pixel * width * height, width, height)
    took = 0.01 + seconds_per_pixel * width * height
    if seconds_per_pixel == 2e-7:
        assert took == pytest.approx(0.04, rel=0.02)
    elif seconds_per_pixel < 1e-7:
        assert height == full_height(window) == 1080 and took < 0.04
    else:
        assert height == 96
