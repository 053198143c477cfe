"""Surfels inside the mouth of the procedural head, from its capture to the avatar's file."""

from dataclasses import replace

import numpy as np
import pytest

from carigs.capture import Capture
from carigs.exaggeration import GammaPath
from carigs.mouth import Jaw, lip_line
from carigs.settings import Density, Toy, Train
from carigs.splat.avatar import Avatar, load_avatar, save_avatar
from carigs.splat.rig.head_sequence import head_sequence
from carigs.splat.training.initial_surfels.initialization import initial_surfels
from carigs.splat.training.initial_surfels.mouth_surfels import prepare_mouth
from carigs.splat.training.subject import TrainingSubject
from carigs.splat.training.supervision import Supervision
from carigs.splat.training.trainer import train_surfels
from evaluation.benchmarks.measurement.toy_frames import write_subject

TOY = Toy(width=72, height=96, cameras=4, steps_per_sequence=1, supersampling=1, texture_size=128, hair_strands=50)
SETTINGS = Train(iterations=8, gtstar_probability=0.0, mouth_surfels=200, density=Density(every=0))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("toy")
    write_subject(folder, TOY)
    return folder


@pytest.fixture
def subject(files):
    capture = Capture.load(files / "capture.json")
    return capture, head_sequence(capture, GammaPath.load(files / "path.npz"))


def test_points_lie_behind_the_lips_and_the_jaws_move(subject):
    capture, sequence = subject
    points = prepare_mouth(capture, sequence, SETTINGS)
    line = lip_line(sequence.head, sequence.rig.vertices)
    assert len(points.face) == 200
    assert set(sequence.solids.solids[points.face]) == {Jaw.UPPER, Jaw.LOWER}
    assert line.depth(points.position).min() > 0
    assert np.linalg.norm(points.position - line.middle, axis=1).max() < line.width


def test_nothing_is_added_without_a_mouth_to_look_into(subject):
    capture, sequence = subject
    assert prepare_mouth(capture, sequence, replace(SETTINGS, mouth_surfels=0)) is None
    still = {t: replace(p, expression=0 * p.expression, joints=0 * p.joints) for t, p in sequence.parameters.items()}
    open_mouth = sequence.parameters
    sequence.parameters = still
    assert prepare_mouth(capture, sequence, SETTINGS) is None
    sequence.parameters, sequence.head = open_mouth, replace(sequence.head, landmarks68=None)
    assert prepare_mouth(capture, sequence, SETTINGS) is None
    assert sequence.solids is None


def test_teeth_of_the_model_carry_the_points_as_they_are(subject):
    """Regions of teeth stand for the jaws; their triangles keep their own motion."""
    capture, sequence = subject
    rest = sequence.rig.vertices
    line = lip_line(sequence.head, rest)
    near = np.linalg.norm(rest - line.middle, axis=1) < line.width
    teeth = {"teeth_upper": near & (line.height(rest) > 0), "teeth_lower": near & (line.height(rest) < 0)}
    regions = {name: np.flatnonzero(inside) for name, inside in teeth.items()}
    sequence.head = replace(sequence.head, regions={**sequence.head.regions, **regions})
    points = prepare_mouth(capture, sequence, SETTINGS)
    assert sequence.solids is None
    assert np.isin(points.face, np.flatnonzero(sequence.head.face_region(*teeth))).all()


def test_first_surfels_are_transparent_and_have_the_colours_behind_the_lips(subject):
    capture, sequence = subject
    points = prepare_mouth(capture, sequence, SETTINGS)
    supervision = Supervision(capture)
    start = initial_surfels(SETTINGS, supervision, sequence, None, [points])
    plain = initial_surfels(SETTINGS, supervision, sequence)
    assert len(start) == len(plain) + 200
    opacity = start.opacity.detach().sigmoid().numpy()
    assert np.isclose(opacity, points.opacity, atol=1e-6).sum() == 200


def test_an_avatar_keeps_its_jaws(subject, tmp_path):
    capture, sequence = subject
    points = prepare_mouth(capture, sequence, SETTINGS)
    surfels, _ = train_surfels(SETTINGS, TrainingSubject(sequence, Supervision(capture), mouth=points))
    avatar = Avatar(surfels, sequence, SETTINGS.rig, SETTINGS.rotate_harmonics, capture.background)
    save_avatar(tmp_path / "avatar.npz", avatar)
    again, frame = load_avatar(tmp_path / "avatar.npz"), capture.split("test")[0]
    np.testing.assert_array_equal(again.sequence.solids.solids, sequence.solids.solids)
    views = [each.render(frame.timestep, 0.2, capture.camera(frame)) for each in (avatar, again)]
    np.testing.assert_array_equal(*views)
    again.sequence.solids = None
    again.sequence._motions.clear()
    assert not np.array_equal(again.render(frame.timestep, 0.2, capture.camera(frame)), views[0])
