"""The shirt: below the head, closed around the neck, and moved by the root joint alone."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from carigs.capture import Capture
from carigs.exaggeration import Caricature
from carigs.hair import find_hair
from carigs.head import HeadParameters, flame_joints, neutral
from carigs.head.neck_border import neck_border
from carigs.settings import CaptureSettings, Hair, Toy
from carigs.stages.capture import capture as capture_stage
from carigs.toy import load_subject, make_subject, pose_subject
from carigs.toy.scene import studio_cameras, timesteps

SETTINGS = Toy(width=104, height=136, cameras=5, steps_per_sequence=1, texture_size=256, supersampling=2)
PLAIN, DRESSED = replace(SETTINGS, hair_strands=400), replace(SETTINGS, hair_strands=400, shirt=True)


@pytest.fixture(scope="module")
def plain():
    return make_subject(PLAIN)


@pytest.fixture(scope="module")
def dressed():
    return make_subject(DRESSED)


def test_only_a_root_that_moves_moves_the_shirt(dressed):
    turn, shift = Rotation.from_rotvec([0.1, -0.3, 0.2]), np.array([0.01, 0.02, -0.03])
    nodding = HeadParameters(
        shape=dressed.shape, expression=np.ones(100), joints=flame_joints(neck=[0.2, 0.3, 0.1], jaw=[0.2, 0, 0])
    )
    grown = Caricature(0.05 * np.random.default_rng(0).standard_normal(dressed.model.v_template.shape))
    still = pose_subject(dressed, HeadParameters(shape=dressed.shape)).shirt
    np.testing.assert_array_equal(pose_subject(dressed, nodding).shirt, still)
    np.testing.assert_array_equal(pose_subject(dressed, nodding, grown).shirt, still)
    np.testing.assert_allclose(still, dressed.shirt.vertices, atol=1e-6)
    turned = pose_subject(dressed, replace(nodding, rotation=turn.as_rotvec(), translation=shift), grown).shirt
    root = dressed.model.joint_regressor[0] @ neutral(dressed.model, nodding)
    np.testing.assert_allclose(turned, turn.apply(still - root) + root + shift, atol=1e-6)


def test_head_and_hair_are_those_of_the_person_without_a_shirt(plain, dressed):
    """All pixels above shirt and neck are the same; the collar casts its shadow on the neck."""
    assert plain.shirt is None
    for step in timesteps(SETTINGS, plain.shape)[::4]:
        before, after = (pose_subject(who, step.parameters) for who in (plain, dressed))
        for camera in studio_cameras(SETTINGS)[::2]:
            pixels, _ = camera.project(np.concatenate([after.shirt, before.head[dressed.model.regions["neck"]]]))
            rows = slice(0, int(pixels[:, 1].min()) - 1)
            for mine, theirs in zip(before.render(camera), after.render(camera), strict=True):
                np.testing.assert_array_equal(mine[rows], theirs[rows])


def test_no_camera_looks_between_neck_and_collar(dressed):
    """Below the border of the neck, all is covered from there to the lower end of the image."""
    border = neck_border(dressed.model, neutral(dressed.model, HeadParameters(shape=dressed.shape)))
    for step in timesteps(SETTINGS, dressed.shape):
        posed = pose_subject(dressed, step.parameters)
        for camera in studio_cameras(SETTINGS):
            _, coverage = posed.render(camera)
            column, row = camera.project(posed.head[border.vertices].mean(axis=0, keepdims=True))[0][0].astype(int)
            assert (coverage[row:, column - 8 : column + 9] == 1).all()


def test_a_saved_shirt_is_read_again(plain, dressed, tmp_path):
    dressed.model.save(tmp_path / "head_model.npz")
    dressed.save(tmp_path / "subject.npz")
    for mine, theirs in zip(dressed.shirt, load_subject(tmp_path).shirt, strict=True):
        np.testing.assert_array_equal(mine, theirs)
    plain.save(tmp_path / "subject.npz")
    assert load_subject(tmp_path).shirt is None


@pytest.mark.slow
def test_the_shirt_is_found_as_a_body_and_not_as_hair(tmp_path):
    found = {}
    for name, toy in (("plain", PLAIN), ("dressed", DRESSED)):
        settings, index = CaptureSettings(toy=replace(toy, hair_strands=3000)), tmp_path / f"{name}.json"
        capture_stage(settings, index=index, dataset=tmp_path / name)
        found[name] = find_hair(Hair(), subject := Capture.load(index))
    border = neck_border(subject.model, neutral(subject.model, subject.parameters(0)))
    plain, dressed = found["plain"], found["dressed"]
    assert plain.body is None and dressed.body is not None
    assert not border.lies_above(dressed.body.volume.centres).any()
    assert border.lies_above(dressed.volume.centres).all()
    assert dressed.volume.opacity.sum() == pytest.approx(plain.volume.opacity.sum(), rel=0.02)
    uncarried = ~border.carriers
    assert (dressed.covered != plain.covered)[uncarried].mean() < 0.01
