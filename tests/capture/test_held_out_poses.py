"""How far the head poses of test frames lie from those of training frames."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_head import small_head

from carigs.capture import Camera, look_at
from carigs.capture.held_out_poses import MARGIN, facing, pose_gap, turn_angles
from carigs.head import HeadParameters, pose


def turns(*angles):
    """Rotations of yaw, pitch and roll in degrees."""
    return Rotation.from_euler("YXZ", np.atleast_2d(angles), degrees=True).as_matrix()


def camera_at(centre, target):
    return Camera(look_at(np.array(centre, float), np.array(target, float)), 500.0, 500.0, 100.0, 100.0, 200, 200)


@pytest.mark.parametrize("angles", [(0, 0, 0), (30, 0, 0), (0, 20, 0), (0, 0, -15), (-40, 25, 10), (170, -60, 80)])
def test_yaw_pitch_and_roll_are_those_of_the_rotation(angles):
    np.testing.assert_allclose(turn_angles(turns(angles)), [angles], atol=1e-9)


@pytest.mark.parametrize("target", [(0.0, 0.05, 0.0), (0.2, 0.05, 0.0), (0.1, -0.2, 0.1)])
def test_a_head_that_looks_into_the_camera_is_not_turned_wherever_it_is_in_the_image(target):
    model = small_head()
    upper = model.v_template[:, 1] > np.median(model.v_template[:, 1])
    middle = pose(model, HeadParameters.zeros(model))[upper].mean(axis=0)
    [found] = facing(model, [HeadParameters.zeros(model)], [camera_at(middle + np.array([0, 0, 1.0]), target)])
    direction = found @ [0, 0, 1]
    np.testing.assert_allclose(direction, [0, 0, 1], atol=1e-6)


def test_the_neck_turns_the_skull_and_the_jaw_does_not():
    model = small_head()
    rest = HeadParameters.zeros(model)
    joints = np.zeros_like(rest.joints)
    joints[1, 0] = 0.3
    open_mouth = replace(rest, joints=joints)
    joints = np.zeros_like(rest.joints)
    joints[0] = np.radians([0, 12, 0])
    turned = replace(rest, joints=joints, rotation=np.radians([0.0, 13, 0]))
    # From so far away, the direction to the head stays the same.
    found = facing(model, [rest, open_mouth, turned], [camera_at((0, 0, 1e4), (0, 0, 0))] * 3)
    np.testing.assert_allclose(turn_angles(found), [[0, 0, 0], [0, 0, 0], [25, 0, 0]], atol=1e-3)


def test_a_camera_beside_the_head_sees_it_turned_to_the_other_side():
    model = small_head()
    left = camera_at((np.sin(0.5) * 1e4, 0, np.cos(0.5) * 1e4), (0, 0, 0))  # to the person's left
    [[yaw, pitch, roll]] = turn_angles(facing(model, [HeadParameters.zeros(model)], [left]))
    np.testing.assert_allclose([yaw, pitch, roll], [-np.degrees(0.5), 0, 0], atol=1e-3)


def test_test_frames_among_training_frames_are_not_outside():
    train = turns(*((yaw, pitch, 0) for yaw in range(-30, 31, 10) for pitch in (-10, 0, 10)))
    gap = pose_gap(train, train[3:9])
    assert gap.outside == 0 and gap.largest < 1e-5
    between = pose_gap(train, turns((5, 0, 0), (15, 10, 0)))
    assert between.outside == 0 and between.largest == pytest.approx(5)


def test_test_frames_beyond_training_frames_are_counted_and_measured():
    train = turns(*((yaw, 0, 0) for yaw in range(-20, 21, 5)))
    test = turns((0, 0, 0), (20 + MARGIN / 2, 0, 0), (45, 0, 0), (0, 0, 12))
    gap = pose_gap(train, test)
    assert (gap.tested, gap.trained, gap.outside) == (4, 9, 0.5)
    assert gap.largest == pytest.approx(25)
    assert gap.median == pytest.approx((12 + MARGIN / 2) / 2)
    assert "50 %" in str(gap) and "25.0 at most" in str(gap)


def test_as_many_frames_as_large_captures_have_are_compared_in_parts():
    random = Rotation.random(3000, random_state=0).as_matrix()
    train, test = random[:2000], random[2000:]
    relative = np.einsum("mji,njk->mnik", test[:20], train)
    expected = np.degrees(np.linalg.norm(Rotation.from_matrix(relative.reshape(-1, 3, 3)).as_rotvec(), axis=1))
    largest = expected.reshape(20, -1).min(axis=1).max()
    assert pose_gap(train, test[:20]).largest == pytest.approx(largest, abs=1e-6)
    whole = pose_gap(train, test)
    parts = [pose_gap(train, test[i : i + 100]).largest for i in range(0, 1000, 100)]
    assert whole.largest == max(parts)
