"""Cameras: axes, projection, round trips."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from carigs.capture import Camera, look_at

coordinate = st.floats(-3, 3)


@given(st.tuples(coordinate, coordinate, st.floats(0.5, 4)))
def test_looks_at_its_target_upright(centre):
    camera = Camera(look_at(np.array(centre), np.zeros(3)), 100, 100, 32, 24, 64, 48)
    np.testing.assert_allclose(camera.centre, centre, atol=1e-12)
    pixel, depth = camera.project(np.zeros((1, 3)))
    np.testing.assert_allclose(pixel[0], [32, 24], atol=1e-9)
    np.testing.assert_allclose(depth[0], np.linalg.norm(centre))
    above, _ = camera.project(np.array([[0, 0.1, 0]]))
    assert above[0, 1] < 24  # image y points down, world y up


@given(st.tuples(coordinate, coordinate, st.floats(0.5, 4)), st.tuples(coordinate, coordinate, coordinate))
def test_world_from_camera_inverts(centre, point):
    camera = Camera(look_at(np.array(centre), np.zeros(3)), 100, 100, 32, 24, 64, 48)
    there = camera.to_camera(np.array([point]))
    back = there @ camera.world_from_camera[:3, :3].T + camera.world_from_camera[:3, 3]
    np.testing.assert_allclose(back[0], point, atol=1e-9)


def test_scaling_scales_pixels():
    camera = Camera(look_at(np.array([0.2, 0.1, 2]), np.zeros(3)), 100, 90, 31, 25, 64, 48)
    points = np.random.default_rng(0).normal(size=(20, 3)) * 0.3
    np.testing.assert_allclose(camera.scaled(3).project(points)[0], 3 * camera.project(points)[0])


@pytest.mark.parametrize("changed", [field.name for field in fields(Camera)])
def test_cameras_are_equal_if_all_their_numbers_are(changed):
    camera = Camera(look_at(np.array([0.2, 0.1, 2]), np.zeros(3)), 100, 90, 31, 25, 64, 48)
    assert camera == replace(camera, camera_from_world=camera.camera_from_world.copy())
    assert camera != replace(camera, **{changed: getattr(camera, changed) + 1})
    assert camera != camera.intrinsics
