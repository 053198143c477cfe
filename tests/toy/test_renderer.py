"""True images: coverage, motion, light, hair and texture obey what they are defined by."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from carigs.capture import Camera
from carigs.capture.images import to_linear
from carigs.exaggeration import Caricature
from carigs.head import HeadParameters, flame_joints, neutral
from carigs.settings import Toy
from carigs.toy import ToySubject, load_subject, make_subject, render_subject
from carigs.toy.look.hair_rendering import ribbon_faces, strand_ribbons
from carigs.toy.look.lighting import StudioLight
from carigs.toy.look.strands import triangle_frames
from carigs.toy.scene import frontal_camera, studio_cameras

SETTINGS = Toy(width=96, height=128, cameras=3, supersampling=2, texture_size=200, hair_strands=800)


@pytest.fixture(scope="module")
def subject() -> ToySubject:
    return make_subject(SETTINGS)


@pytest.fixture(scope="module")
def camera() -> Camera:
    cameras = studio_cameras(SETTINGS)
    return cameras[frontal_camera(cameras)]


def person(subject: ToySubject, **fields: np.ndarray) -> HeadParameters:
    return HeadParameters(shape=subject.shape, **fields)


def test_coverage_and_background(subject: ToySubject, camera: Camera) -> None:
    colour, alpha = render_subject(subject, person(subject), camera)
    assert colour.shape == (128, 96, 3) and alpha.shape == (128, 96)
    assert alpha.min() == 0 and alpha.max() == 1 and colour.min() >= 0 and colour.max() <= 1
    assert (colour[alpha == 0] == 1).all()
    assert ((alpha * 4) % 1 == 0).all()  # four samples to the pixel
    assert 0.2 < alpha.mean() < 0.6
    rows, columns = np.nonzero(alpha.max(axis=1))[0], np.nonzero(alpha.max(axis=0))[0]
    assert np.ptp(rows) > 0.8 * 128  # the head with neck and hair fills the frame, and is whole
    assert rows[0] > 0 and rows[-1] < 127 and columns[0] > 0 and columns[-1] < 95


def test_head_light_and_camera_may_move_together(subject: ToySubject, camera: Camera) -> None:
    turn, shift = Rotation.from_euler("yxz", [0.5, -0.3, 0.2]), np.array([0.03, -0.05, 0.1])
    root = (subject.model.joint_regressor @ neutral(subject.model, person(subject)))[0]
    # p -> R p + t, where the model turns about its root joint.
    moved = person(subject, rotation=turn.as_rotvec(), translation=turn.apply(root) + shift - root)
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = turn.as_matrix(), shift
    follower = replace(camera, camera_from_world=camera.camera_from_world @ np.linalg.inv(motion))
    still = render_subject(subject, person(subject), camera)
    together = render_subject(subject, moved, follower, world_from_light=turn.as_matrix())
    # The shadow map's grid turns with the head only up to rounding.
    assert np.abs(still[1] - together[1]).mean() < 1e-3
    assert np.abs(still[0] - together[0]).mean() < 4e-3
    # The light belongs to the world: without turning it, the same person looks different.
    unlit = render_subject(subject, moved, follower)[0]
    assert np.abs(still[0] - unlit).mean() > 5 * np.abs(still[0] - together[0]).mean()


def test_a_caricature_that_only_shifts_is_a_translation(subject: ToySubject, camera: Camera) -> None:
    shift = np.array([0.01, -0.02, 0.015])
    everywhere = Caricature(np.tile(shift, (len(subject.model.v_template), 1)))
    by_offset = render_subject(subject, person(subject), camera, everywhere)
    by_pose = render_subject(subject, person(subject, translation=shift), camera)
    assert np.abs(by_offset[0] - by_pose[0]).mean() < 1e-3 and np.abs(by_offset[1] - by_pose[1]).mean() < 1e-3


def test_no_displacement_and_static_offset_are_the_same_as_none(subject: ToySubject, camera: Camera) -> None:
    zeros = np.zeros(subject.model.v_template.shape)
    plain = render_subject(subject, person(subject), camera)
    for other in (
        render_subject(subject, person(subject), camera, Caricature(zeros)),
        render_subject(subject, person(subject, static_offset=zeros), camera),
    ):
        np.testing.assert_array_equal(plain[0], other[0])
        np.testing.assert_array_equal(plain[1], other[1])


def test_closed_lips_hide_the_teeth_and_open_ones_show_them(subject: ToySubject, camera: Camera) -> None:
    green = replace(subject, teeth_colours=np.tile(np.float32([0, 1, 0]), (len(subject.teeth), 1)))

    def differs(parameters: HeadParameters) -> bool:
        mine, theirs = (render_subject(who, parameters, camera)[0] for who in (subject, green))
        return np.abs(mine - theirs).max() > 0

    assert not differs(person(subject))
    assert differs(person(subject, joints=flame_joints(jaw=[0.2, 0, 0])))


def test_equal_seeds_give_equal_people_and_others_differ(subject: ToySubject) -> None:
    again, other = make_subject(SETTINGS), make_subject(replace(SETTINGS, seed=2))
    for name in ("shape", "ambient_visibility", "teeth"):
        np.testing.assert_array_equal(getattr(again, name), getattr(subject, name))
    for group in ("atlas", "strands"):
        for mine, theirs in zip(getattr(subject, group), getattr(again, group), strict=True):
            np.testing.assert_array_equal(mine, theirs)
    apart = neutral(subject.model, person(subject)) - neutral(other.model, person(other))
    assert np.linalg.norm(apart, axis=1).max() > 0.003
    assert np.abs(subject.atlas.texels.astype(int) - other.atlas.texels).mean() > 3


def test_a_saved_person_gives_the_same_images(subject: ToySubject, camera: Camera, tmp_path) -> None:
    subject.model.save(tmp_path / "head_model.npz")
    subject.save(tmp_path / "subject.npz")
    again = load_subject(tmp_path)
    for mine, theirs in zip(
        render_subject(subject, person(subject), camera), render_subject(again, person(again), camera), strict=True
    ):
        np.testing.assert_array_equal(mine, theirs)


def test_hair_turns_with_its_triangle_and_keeps_its_length(subject: ToySubject) -> None:
    strands, faces = subject.strands, subject.model.faces
    rest = neutral(subject.model, person(subject))
    turn = Rotation.from_rotvec([0.3, -0.8, 0.4]).as_matrix()
    np.testing.assert_allclose(triangle_frames(rest @ turn.T, faces), triangle_frames(rest, faces) @ turn.T, atol=1e-9)
    # A caricature may stretch the roots' triangles: the strands stay as long as they grew.
    stretched = rest * [1.5, 1.0, 0.7]
    roots = np.einsum("si,sij->sj", strands.barycentric, stretched[faces[strands.face]])
    axes = triangle_frames(stretched, faces)[strands.face]
    ribbon, _ = strand_ribbons(
        strands, to_linear(strands.colour), roots, axes, 1e-3, np.array([0.0, 0.0, 1.0]), StudioLight()
    )
    middle = ribbon.reshape(len(roots), -1, 2, 3).mean(axis=2)
    grown = np.linalg.norm(np.diff(strands.local.astype(float), axis=1), axis=2) * 1e-3
    np.testing.assert_allclose(np.linalg.norm(np.diff(middle, axis=1), axis=2), grown, atol=1e-8)
    np.testing.assert_allclose(middle[:, 0], roots, atol=1e-12)
    corners = ribbon_faces(len(roots), 8, 5)
    assert corners.min() == 5 and corners.max() == 4 + len(ribbon) and len(corners) == 14 * len(roots)


def test_scalp_hair_leaves_the_mesh(subject: ToySubject) -> None:
    tips = subject.strands.local[:, -1, 2]  # along the root triangle's normal, millimetres
    on_scalp = np.isin(subject.model.faces[subject.strands.face], subject.model.regions["scalp"]).all(axis=1)
    assert on_scalp.sum() > 400 and np.median(tips[on_scalp]) > 1
