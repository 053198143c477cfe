"""A motion of one head for another one."""

from dataclasses import replace

import numpy as np
import pytest
from motion.motions import random_motion
from scipy.spatial.transform import Rotation
from shared_data import DATA, needs_data
from small_head import small_head

from carigs.errors import CarigsWarning, SettingsError
from carigs.head import HeadModel, HeadParameters, pose
from carigs.motion import BUILT_IN, Motion, Retargeting
from carigs.motion.displacement_map import landmark_actions, shipped_actions
from carigs.motion.retargeting import EASE, FULL_GAZE, FULL_JAW, own_motion
from carigs.toy.rig.head_model import head_model

AWAY = np.array([1.0, 2.0, 3.0])


def random_frames(model: HeadModel, count: int = 6, seed: int = 0) -> list[HeadParameters]:
    random = np.random.default_rng(seed)
    zeros = HeadParameters.zeros(model)
    named = len(model.expression_names) or model.num_expressions
    return [
        replace(
            zeros, expression=np.pad(random.random(named), (0, model.num_expressions - named)),
            joints=0.1 * random.normal(size=zeros.joints.shape), rotation=0.3 * random.normal(size=3),
            translation=0.1 * random.normal(size=3),
        )
        for _ in range(count)
    ]  # fmt: skip


@pytest.mark.parametrize("model", [small_head(), head_model()], ids=["numbers", "names"])
def test_a_head_follows_its_own_capture(model):
    frames = random_frames(model)
    found = Retargeting.to_frames(model, frames)(own_motion(model, frames, 30.0))
    for a, b in zip(found, frames, strict=True):
        for name in ("expression", "joints", "rotation", "translation"):
            np.testing.assert_allclose(getattr(a, name), getattr(b, name), atol=1e-12)


def test_the_head_moves_relative_to_its_rest():
    """The driver's own world does not matter, and a driver at rest leaves the head at its rest."""
    model = small_head()
    frames = random_frames(model)
    retargeting = Retargeting.to_frames(model, frames)
    motion = replace(random_motion(names=("0",)), joints={})
    world = Rotation.from_rotvec([0.4, -1.0, 0.7])

    def moved(rotation, translation):
        return (world * Rotation.from_rotvec(rotation)).as_rotvec(), world.apply(translation) + AWAY

    rotation, translation = moved(motion.rotation, motion.translation)
    rest_rotation, rest_translation = moved(motion.rest_rotation, motion.rest_translation)
    elsewhere = replace(
        motion,
        rotation=rotation,
        translation=translation,
        rest_rotation=rest_rotation,
        rest_translation=rest_translation,
    )
    for a, b in zip(retargeting(motion), retargeting(elsewhere), strict=True):
        turns = [Rotation.from_rotvec(p.rotation).as_matrix() for p in (a, b)]
        np.testing.assert_allclose(turns[0], turns[1], atol=1e-12)
        np.testing.assert_allclose(a.translation, b.translation, atol=1e-12)
    resting = replace(motion, rotation=np.tile(motion.rest_rotation, (len(motion), 1)), translation=None)
    resting = replace(resting, rest_translation=np.zeros(3))
    (first, *_) = retargeting(resting)
    np.testing.assert_allclose(first.rotation, frames[0].rotation, atol=1e-12)
    np.testing.assert_allclose(first.translation, frames[0].translation, atol=1e-12)


def test_arkit_drives_joints_of_a_head_without_names():
    """FLAME has no jawOpen and no eyeLook...: its joints turn. The jaw opens downwards, eyes look where they should."""
    model = small_head()
    names = ("jawOpen", "eyeLookOutLeft", "eyeLookInRight", "eyeLookDownLeft", "eyeLookDownRight")
    retargeting = Retargeting.to_frames(model, [HeadParameters.zeros(model)])
    (found,) = retargeting(Motion(30.0, names, np.array([[0.5, 1.0, 1.0, 0.5, 0.5]])))
    jaw, *eyes = found.joints[1:]
    np.testing.assert_allclose(jaw, [0.5 * FULL_JAW, 0, 0])
    for eye in eyes:
        np.testing.assert_allclose(eye, [0.5 * FULL_GAZE, FULL_GAZE, 0])
        ahead = Rotation.from_rotvec(eye).apply([0, 0, 1.0])
        assert ahead[0] > 0 > ahead[1]  # to the person's left, down


def test_coefficients_beyond_the_capture_are_eased_and_reported():
    model = small_head()
    low, high = replace(HeadParameters.zeros(model), expression=np.zeros(5)), HeadParameters.zeros(model)
    high = replace(high, expression=np.full(5, 0.4))
    values = np.linspace(-3, 3, 61)
    motion = Motion(30.0, ("2",), values[:, None])
    with pytest.warns(CarigsWarning, match=r"beyond those of the avatar's capture, eased: 2 \(by 3"):
        found = np.array([frame.expression[2] for frame in Retargeting.to_frames(model, [low, high])(motion)])
    inside = (values >= 0) & (values <= 0.4)
    np.testing.assert_array_equal(found[inside], values[inside])
    assert (np.diff(found) > 0).all() and found.max() < 0.4 + EASE and found.min() > -EASE
    assert np.diff(found).max() <= np.diff(values).max() + 1e-12


def test_what_cannot_be_mapped_is_said():
    toy = head_model()
    retargeting = Retargeting.to_frames(toy, random_frames(toy))
    some = Motion(30.0, ("jawOpen", "tongueOut"), np.full((3, 2), 0.3))
    with pytest.warns(CarigsWarning, match="does not have, left out: tongueOut"):
        retargeting(some)
    with pytest.raises(SettingsError, match="none of the expressions tongueOut: name the head model"):
        retargeting(Motion(30.0, ("tongueOut",), np.full((3, 1), 0.3)))
    with pytest.warns(CarigsWarning, match="taken for the avatar's own"):
        retargeting(Motion(30.0, ("0", "1"), np.full((3, 2), 0.3)))
    with pytest.raises(SettingsError, match="numbered expressions, the avatar has 100"):
        retargeting(Motion(30.0, ("0", "120"), np.full((3, 2), 0.3)))


def opening(model: HeadModel, frames: list[HeadParameters], upper: int, lower: int) -> np.ndarray:
    """Distance of two of the 68 landmarks over time."""
    points = np.array([model.landmarks68.interpolate(pose(model, frame)) for frame in frames])
    return np.linalg.norm(points[:, upper] - points[:, lower], axis=1)


MOUTH, LEFT_LID, RIGHT_LID = (62, 66), (43, 47), (38, 40)
"""Landmarks of iBUG: inner lips, and the middle of the upper and the lower lid."""


def correlations(driver, driver_frames, head, frames) -> list[float]:
    pairs = [
        [opening(m, f, *where) for m, f in ((driver, driver_frames), (head, frames))]
        for where in (MOUTH, LEFT_LID, RIGHT_LID)
    ]
    return [float(np.corrcoef(*pair)[0, 1]) for pair in pairs]


@needs_data
@pytest.mark.filterwarnings("ignore:.*left out", "ignore:.*eased")
def test_mouth_and_lids_follow_the_driver_by_names_in_both_directions():
    toy, ict = head_model(), HeadModel.load(DATA / "ict_model.npz")
    for driver, head in ((ict, toy), (toy, ict)):
        frames = random_frames(driver, 12, seed=2)
        still = np.zeros((4, 3))
        frames = [replace(frame, expression=_some(driver, frame.expression), joints=still) for frame in frames]
        motion = own_motion(driver, frames, 30.0)
        found = Retargeting.to_frames(head, [HeadParameters.zeros(head)])(motion)
        assert min(correlations(driver, frames, head, found)) > 0.95


def _some(model: HeadModel, expression: np.ndarray) -> np.ndarray:
    """Only what opens the mouth and closes the lids."""
    kept = [name.lower().replace("_", "").startswith(("jawopen", "eyeblink")) for name in model.expression_names]
    return np.where(np.pad(kept, (0, model.num_expressions - len(kept))), expression, 0)


@pytest.mark.filterwarnings("ignore:.*left out", "ignore:.*eased")
def test_a_head_whose_expressions_have_no_names_follows_by_displacement():
    """The procedural head without its names: least squares finds the coefficients that names would give."""
    toy = head_model()
    nameless = replace(toy, expression_names=())
    talk = BUILT_IN["talk"](2.0)
    retargeting = Retargeting.to_frames(nameless, [HeadParameters.zeros(nameless)], toy)
    found = retargeting(talk)
    by_names = Retargeting.to_frames(toy, [HeadParameters.zeros(toy)])(talk)
    assert min(correlations(toy, by_names, nameless, found)) > 0.95
    for t in (10, 35):
        moved, wanted = (pose(toy, replace(f[t], joints=by_names[t].joints)) for f in (found, by_names))
        still = pose(toy, replace(by_names[t], expression=np.zeros(100)))
        assert np.linalg.norm(moved - wanted) < 0.35 * np.linalg.norm(wanted - still)


@pytest.mark.filterwarnings("ignore:.*left out", "ignore:.*eased")
def test_heads_of_numbers_follow_named_motions_without_a_driver():
    """What is shipped is the procedural head: a head of numbers follows ARKit's names, as with the head as driver."""
    toy = head_model()
    nameless = replace(toy, expression_names=())
    talk = BUILT_IN["talk"](2.0)
    rest = [HeadParameters.zeros(nameless)]
    found, with_driver = (Retargeting.to_frames(nameless, rest, driver)(talk) for driver in (None, toy))
    for a, b in zip(found, with_driver, strict=True):
        np.testing.assert_allclose(a.expression, b.expression, atol=2e-3)
        np.testing.assert_allclose(a.joints, b.joints, atol=2e-3)


def test_the_shipped_actions_are_those_of_the_procedural_head():
    shipped, made = shipped_actions(), landmark_actions(head_model())
    named = len(shipped.names)
    assert shipped.names == made.names[:named]
    np.testing.assert_array_equal(shipped.landmarks, made.landmarks)
    np.testing.assert_allclose(shipped.points, made.points, atol=1e-6)
    np.testing.assert_allclose(shipped.basis, made.basis[:, :, :named], atol=1.1e-6)


@needs_data
@pytest.mark.filterwarnings("ignore:.*left out", "ignore:.*eased")
def test_lids_and_mouth_of_another_head_of_numbers_follow_a_named_driver():
    """ICT-FaceKit without names, driven by the procedural head's names: another mesh, other expressions."""
    toy, ict = head_model(), HeadModel.load(DATA / "ict_model.npz")
    nameless = replace(ict, expression_names=())
    frames = [
        replace(f, expression=_some(toy, f.expression), joints=0 * f.joints) for f in random_frames(toy, 12, seed=2)
    ]
    found = Retargeting.to_frames(nameless, [HeadParameters.zeros(nameless)])(own_motion(toy, frames, 30.0))
    assert min(correlations(toy, frames, nameless, found)) > 0.9
