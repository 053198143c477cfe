"""Edits of a motion, by what must hold for every motion."""

from dataclasses import replace

import numpy as np
import pytest
from motion.motions import largest_difference, random_motion
from scipy.spatial.transform import Rotation

from carigs.errors import SettingsError
from carigs.motion import BUILT_IN, Motion
from carigs.motion.editing import (
    looped,
    mirrored,
    neutralised,
    resampled,
    smoothed,
    strengthened,
    trimmed,
)
from carigs.motion.facial_actions import actions, part
from carigs.motion.one_euro import one_euro


@pytest.mark.parametrize("fps", [12.0, 29.97, 60.0, 144.0])
def test_a_linear_motion_is_resampled_exactly(fps):
    """Numbers that grow linearly, and a rotation about one axis at a constant speed."""
    t = np.arange(31) / 30.0
    axis = np.array([0.6, 0.0, 0.8])
    neck, moved = 2.5 * t[:, None] * axis, t[:, None] * axis
    motion = Motion(30.0, ("jawOpen",), 0.3 * t[:, None], {"neck": neck}, translation=moved)
    found = resampled(motion, fps)
    times = np.arange(len(found)) / fps
    assert found.fps == fps and len(found) == int(np.floor(fps + 1e-9)) + 1
    np.testing.assert_allclose(found.expression[:, 0], 0.3 * times, atol=1e-12)
    np.testing.assert_allclose(found.joints["neck"], 2.5 * times[:, None] * axis, atol=1e-9)
    np.testing.assert_allclose(found.translation, times[:, None] * axis, atol=1e-12)


def test_resampling_keeps_what_it_finds_at_a_frame():
    motion = random_motion()
    twice = resampled(motion, 60.0)
    assert largest_difference(twice.frames(np.arange(0, len(twice), 2)), motion) < 1e-12
    assert largest_difference(resampled(twice, 30.0), motion) < 1e-12
    assert resampled(motion, motion.fps) is motion and len(resampled(trimmed(motion, 0, 0.01), 60.0)) == 1


def test_mirroring_twice_is_the_identity_and_once_is_a_mirror():
    motion = random_motion()
    once = mirrored(motion)
    assert largest_difference(mirrored(once), motion) == 0
    left, right = (motion.names.index(f"eyeBlink{side}") for side in ("Left", "Right"))
    np.testing.assert_array_equal(once.expression[:, left], motion.expression[:, right])
    np.testing.assert_array_equal(once.expression[:, 0], motion.expression[:, 0])
    mirror = np.diag([-1.0, 1.0, 1.0])
    turned = Rotation.from_rotvec(motion.joints["left_eye"]).as_matrix()
    expected = mirror @ turned @ mirror
    np.testing.assert_allclose(Rotation.from_rotvec(once.joints["right_eye"]).as_matrix(), expected, atol=1e-12)
    np.testing.assert_array_equal(once.translation, motion.translation @ mirror)
    with pytest.raises(SettingsError, match="7 cannot be mirrored"):
        mirrored(random_motion(names=("jawOpen", "7")))


def test_trimming_cuts_at_times():
    motion = random_motion(fps=10.0)
    assert largest_difference(trimmed(motion, 0.5, 1.0), motion.frames(np.arange(5, 10))) == 0
    assert trimmed(motion).fps == 10 and len(trimmed(motion)) == len(motion)
    with pytest.raises(SettingsError, match="no frame from 9 s"):
        trimmed(motion, 9.0)


def test_a_loop_has_the_length_and_no_jump():
    t = np.linspace(0, 1, 60)[:, None]
    motion = Motion(30.0, ("jawOpen",), t)  # its ends differ by 1
    for seconds in (1.0, 2.0, 5.0, 9.97):
        found = looped(motion, seconds)
        assert len(found) == round(30 * seconds)
        assert np.abs(np.diff(found.expression, axis=0)).max() < 0.15
    assert largest_difference(looped(motion, 1.0), motion.frames(np.arange(30))) == 0
    still = Motion(30.0, ("jawOpen",), np.full((1, 1), 0.4))
    np.testing.assert_allclose(looped(still, 2.0).expression, 0.4)


@pytest.mark.parametrize("name", BUILT_IN)
def test_built_in_motions_repeat_without_a_jump_and_stay_in_range(name):
    motion = BUILT_IN[name](seconds=6.0, seed=3)
    assert len(motion) == 180 and all(actions(expression) for expression in motion.names)
    assert motion.expression.min() >= 0 and motion.expression.max() <= 1
    closed = motion.expression[:, motion.names.index("eyeBlinkLeft")]
    assert closed.max() > 0.95 and np.median(closed) < 0.05
    for array in (motion.expression, motion.joints["neck"]):
        inside, across = np.abs(np.diff(array, axis=0)).max(), np.abs(array[0] - array[-1]).max()
        assert across < inside + 1e-9
    assert np.abs(motion.joints["neck"]).max() < np.radians(12)
    again = BUILT_IN[name](seconds=6.0, seed=3)
    assert largest_difference(motion, again) == 0


def test_only_talk_opens_the_mouth():
    opened = {name: make().expression[:, [part(n) == "jaw" for n in make().names]] for name, make in BUILT_IN.items()}
    assert opened["idle"].size == 0 and opened["talk"].max() > 0.4


def test_the_one_euro_filter_keeps_constants_and_steps_and_removes_trembling():
    random = np.random.default_rng(0)
    constant = np.full((50, 2), 0.7)
    np.testing.assert_array_equal(one_euro(constant, 30, 1.0, 1.0), constant)
    noise = 0.01 * random.normal(size=(600, 1))
    assert one_euro(noise, 30, 1.0, 0.0).std() < 0.5 * noise.std()
    step = (np.arange(60) >= 30).astype(float)[:, None]
    slow, fast = (one_euro(step, 30, 1.0, slope)[33, 0] for slope in (0.0, 5.0))
    assert fast > 0.9 > 0.6 > slow
    assert one_euro(step, 30, 1e6, 0.0) == pytest.approx(step, abs=1e-4)


def test_smoothing_keeps_a_motion_at_rest_and_its_rest():
    motion = random_motion().frames(np.zeros(20, int))
    assert largest_difference(smoothed(motion), motion) < 1e-12


def test_the_neutral_frame_becomes_neutral():
    motion = random_motion()
    found = neutralised(motion, 0.5)
    at = 15
    assert np.abs(found.expression[at]).max() == 0 and found.expression.min() >= 0
    np.testing.assert_array_equal(found.rest_rotation, motion.rotation[at])
    for rotations in found.joints.values():
        np.testing.assert_allclose(rotations[at], 0, atol=1e-12)


def test_strength_acts_on_its_part_alone():
    motion = random_motion()
    found = strengthened(motion, {"jaw": 0.5, "gaze": 0.0, "yaw": -1.0})
    np.testing.assert_array_equal(found.expression[:, 0], 0.5 * motion.expression[:, 0])
    np.testing.assert_array_equal(found.expression[:, 1:], motion.expression[:, 1:])
    assert not found.joints["left_eye"].any()
    np.testing.assert_array_equal(found.joints["neck"], motion.joints["neck"] * [1, -1, 1])
    assert largest_difference(strengthened(motion, {}), motion) == 0
    still = strengthened(motion, {"head": 0.0})
    np.testing.assert_allclose(still.rotation, np.tile(motion.rest_rotation, (len(motion), 1)), atol=1e-12)
    np.testing.assert_array_equal(still.translation, np.tile(motion.rest_translation, (len(motion), 1)))
    with pytest.raises(SettingsError, match="nose=1"):
        strengthened(motion, {"nose": 1.0})


@pytest.mark.parametrize(
    ("change", "match"),
    [
        ({"fps": 0.0}, "0 frames per second"),
        ({"fps": np.nan}, "nan frames per second"),
        ({"expression": np.zeros((0, 6))}, "0 frames"),
        ({"expression": np.full((40, 6), np.nan)}, "expression of frame 0 is not a number"),
        ({"expression": np.zeros((40, 5))}, r"expression has the shape \(40, 5\)"),
        ({"joints": {"jaw": np.zeros((39, 3))}}, "joint jaw has the shape"),
        ({"names": ("a", "a", "b", "c", "d", "e")}, "appears twice"),
    ],
)
def test_impossible_motions_are_refused(change, match):
    with pytest.raises(SettingsError, match=match):
        replace(random_motion(), **change)
