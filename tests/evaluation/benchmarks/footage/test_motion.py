"""The person of the synthetic footage turns as far as asked, closes lids and lips, and rests at the body."""

from itertools import chain

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from carigs.head import pose
from carigs.toy import head_model
from carigs.toy.rig import expressions
from carigs.toy.rig.attributes import sample_attributes
from evaluation.benchmarks.footage import scenes
from evaluation.benchmarks.footage.motion import Talk
from evaluation.benchmarks.footage.truth import FootageTruth

SHAPE = sample_attributes(2).shape


def talk(**changes) -> FootageTruth:
    return scenes.talk(head_model(), SHAPE, 512, Talk(**changes))


def angles(truth: FootageTruth) -> np.ndarray:
    """Yaw to the person's left and pitch down, in degrees."""
    x, y, z = truth.camera_from_head(0)[:, :, 2].T
    return np.degrees([np.arctan2(x, -z), np.arcsin(y)])


def weights(truth: FootageTruth, name: str) -> np.ndarray:
    return np.array([p.expression[expressions.NAMES.index(name)] for p in truth.parameters])


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_turns_and_nods_reach_their_ends(seed):
    yaw, pitch = angles(talk(seed=seed))
    np.testing.assert_allclose([yaw.min(), yaw.max()], [-35, 35], atol=1.5)
    np.testing.assert_allclose([pitch.min(), pitch.max()], [-12, 20], atol=1.5)


def test_a_range_on_one_side_stays_there():
    yaw, _ = angles(talk(yaw=(-5, 35), seconds=4))
    assert yaw.min() > -5.5 and yaw.max() < 35.5 and np.ptp(yaw) > 35


def test_the_head_turns_at_the_neck_and_never_jumps():
    truth = talk()
    body = np.degrees([np.linalg.norm(p.rotation) for p in truth.parameters])
    assert body.max() < 3 and max(np.linalg.norm(p.translation) for p in truth.parameters) < 0.01
    turned = Rotation.from_matrix(truth.world_from_head())
    speed = np.degrees((turned[1:] * turned[:-1].inv()).magnitude()) * 25
    assert speed.max() < 200  # degrees a second


def test_blinks_take_a_fifth_of_a_second_and_close_the_lids():
    truth = talk()
    blink = weights(truth, "eye_blink_left")
    closed = blink > 0.99
    assert 3 <= (np.diff(closed.astype(int)) == 1).sum() <= 8
    half = blink > 0.5
    starts, ends = (np.flatnonzero(np.diff(half.astype(int)) == sign) for sign in (1, -1))
    assert ((ends - starts)[: len(ends)] <= 6).all() and ((ends - starts) >= 3).all()
    upper, lower = truth.model.landmarks68.corners[[43, 44], 0], truth.model.landmarks68.corners[[47, 46], 0]
    gaps = [np.linalg.norm(v[upper] - v[lower], axis=1).max() for v in _heads(truth, [0, np.flatnonzero(closed)[0]])]
    assert gaps[1] < 0.2 * gaps[0]


def test_lips_close_and_the_mouth_opens_wide():
    truth = talk()
    jaw = np.array([p.joints[1, 0] for p in truth.parameters])
    assert jaw.max() > 0.25 and (jaw < 0.005).sum() > 5
    closed = talk(mouth=0.0, blinks=False)
    assert all(p.joints[1, 0] == 0 for p in closed.parameters)
    assert weights(closed, "eye_blink_left").max() < 0.5


def test_equal_seeds_move_equally_and_others_do_not():
    first, again, other = talk(seed=3), talk(seed=3), talk(seed=4)
    assert all((a.expression == b.expression).all() for a, b in zip(first.parameters, again.parameters, strict=True))
    assert np.abs(angles(first) - angles(other)).max() > 5


def test_an_orbit_sees_one_still_head_from_all_sides():
    truth = scenes.orbit(head_model(), SHAPE, 64, Talk(seconds=1))
    yaw, _ = angles(truth)
    assert np.ptp(yaw) == pytest.approx(120, abs=1)
    assert np.ptp(truth.vertices(), axis=0).max() == 0


def test_three_cameras_share_the_time_and_see_the_head_from_two_sides():
    truth = scenes.three(head_model(), SHAPE, 64, Talk(seconds=0.2))
    first = truth.vertices()[0]
    middles = [camera.project(first)[0].mean(axis=0) for camera in truth.cameras[0]]
    assert all(0 < value < 64 for middle in middles for value in middle)
    axes = np.array([camera.camera_from_world[2, :3] for camera in truth.cameras[0]])
    np.testing.assert_allclose(np.degrees(np.arccos(axes @ axes[1])), [35, 0, 35], atol=1e-5)


def test_the_truth_is_the_same_after_reading(tmp_path):
    truth = scenes.three(head_model(), SHAPE, 64, Talk(seconds=0.12))
    truth.save(tmp_path)
    again = FootageTruth.load(tmp_path)
    np.testing.assert_allclose(again.vertices(), truth.vertices(), atol=1e-12)
    assert again.fps == truth.fps
    for mine, theirs in zip(chain(*again.cameras), chain(*truth.cameras), strict=True):
        np.testing.assert_array_equal(mine.camera_from_world, theirs.camera_from_world)
        assert mine.intrinsics == theirs.intrinsics and (mine.width, mine.height) == (theirs.width, theirs.height)


def _heads(truth: FootageTruth, chosen: list[int]) -> list[np.ndarray]:
    return [pose(truth.model, truth.parameters[t]) for t in chosen]
