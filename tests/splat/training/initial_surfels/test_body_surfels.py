"""Surfels of the body move with the border of the neck as one solid."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from carigs.capture import Capture
from carigs.exaggeration import GammaPath
from carigs.hair import find_hair
from carigs.hair.body import Body
from carigs.hair.hull import Voxels
from carigs.head.neck_border import neck_border
from carigs.settings import Density, Hair, Toy, Train
from carigs.splat.rig.head_sequence import head_sequence
from carigs.splat.rig.solid_motion import Solid
from carigs.splat.training.initial_surfels import body_surfels
from carigs.splat.training.initial_surfels.body_surfels import prepare_body
from carigs.splat.training.initial_surfels.initialization import initial_surfels
from carigs.splat.training.subject import prepare_subject
from carigs.splat.training.trainer import train_surfels
from evaluation.benchmarks.measurement.toy_frames import write_subject

TOY = Toy(width=72, height=96, cameras=4, steps_per_sequence=1, supersampling=1, texture_size=128, hair_strands=50)
SETTINGS = Train(
    iterations=6, gtstar_probability=0.0, mouth_surfels=0, density=Density(every=0),
    relight_surfels=False,
)  # fmt: skip


@pytest.fixture(autouse=True)
def fewer_surfels(monkeypatch):
    monkeypatch.setattr(body_surfels, "COUNT", 300)


@pytest.fixture(scope="module")
def subject(tmp_path_factory):
    """The toy, whose frames show no body, and a body that was found all the same."""
    folder = tmp_path_factory.mktemp("toy")
    write_subject(folder, TOY)
    capture, path = Capture.load(folder / "capture.json"), GammaPath.load(folder / "path.npz")
    found = find_hair(Hair(), capture)
    assert found.body is None
    sequence = head_sequence(capture, path)
    border = neck_border(sequence.head, sequence.rig.vertices)
    grid = np.stack(np.meshgrid(*[np.arange(-0.1, 0.1, 0.004)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    centres = (border.centre - [0, 0.12, 0] + grid).astype(np.float32)
    ones = np.ones(len(centres), np.float32)
    return capture, path, replace(found, body=Body(Voxels(centres, ones, 0.004), ones))


def test_points_lie_in_the_body_and_hang_on_the_border(subject):
    capture, path, found = subject
    sequence = head_sequence(capture, path)
    points = prepare_body(found, sequence, SETTINGS)
    border = neck_border(sequence.head, sequence.rig.vertices)
    assert len(points.face) == 300 and border.carriers[points.face].all()
    volume = found.body.volume
    assert (points.position >= volume.centres.min(axis=0) - volume.size).all()
    assert (points.position <= volume.centres.max(axis=0) + volume.size).all()
    np.testing.assert_array_equal(sequence.solids.solids == Solid.BODY, border.carriers)
    frames = points.axes.swapaxes(1, 2) @ points.axes
    np.testing.assert_allclose(frames, np.broadcast_to(np.eye(2), frames.shape), atol=1e-6)


def test_there_are_none_without_a_body(subject):
    capture, path, found = subject
    for body in (None, found.body._replace(visible=0 * found.body.visible)):
        sequence = head_sequence(capture, path)
        assert prepare_body(replace(found, body=body), sequence, SETTINGS) is None and sequence.solids is None


def test_the_body_is_rigid_at_every_timestep_and_level(subject):
    capture, path, found = subject
    sequence = head_sequence(capture, path)
    points = prepare_body(found, sequence, SETTINGS)
    body = np.flatnonzero(sequence.solids.solids == Solid.BODY)
    rest = sequence.rig.vertices[sequence.rig.faces].mean(axis=1)
    for timestep, level in ((0, 0.0), (1, 0.0), (1, path.levels[-1])):
        motion = sequence.motion(timestep, level)
        rotation, stretch = motion.rotation.reshape(-1, 3, 3)[body], motion.jacobian.reshape(-1, 3, 3)[body]
        np.testing.assert_allclose(rotation, np.broadcast_to(rotation[0], rotation.shape), atol=1e-6)
        np.testing.assert_allclose(stretch, rotation, atol=1e-5)
        gap = motion.centre[body] - motion.centre[body[0]] - (rest[body] - rest[body[0]]) @ rotation[0].T
        np.testing.assert_allclose(gap, 0, atol=1e-5)
    assert np.isin(points.face, body).all()


def test_hair_says_nothing_of_the_carriers_and_a_training_moves_surfels_of_the_body(subject):
    capture, path, found = subject
    prepared = prepare_subject(capture, path, SETTINGS, found)
    carriers = prepared.sequence.solids.solids == Solid.BODY
    assert prepared.inside == [prepared.body]
    assert not (prepared.hair.covered & carriers).any() and not (prepared.hair.hidden & carriers).any()
    start = initial_surfels(SETTINGS, prepared.supervision, prepared.sequence, prepared.hair, prepared.inside)
    assert (carriers[start.binding]).sum() == 300 + SETTINGS.surfels_per_face * carriers.sum()
    trained, _ = train_surfels(SETTINGS, prepared)
    assert len(trained) == len(start)


@pytest.mark.parametrize("backend", ["cpu", "torch"])
def test_seen_from_one_side_the_body_has_no_harmonics(subject, backend, monkeypatch):
    capture, path, found = subject
    front = capture.validation_camera
    frames = tuple(replace(frame, split="train") for frame in capture.frames if frame.camera == front)
    single = replace(capture, frames=frames)
    for module in (torch.cuda, torch.backends.mps):
        monkeypatch.setattr(module, "is_available", lambda: False)
    settings = replace(SETTINGS, iterations=2, sh_degree=1, backend=backend)
    prepared = prepare_subject(single, path, settings, found)._replace(hair=None)  # its rules are dear
    assert prepared.same_from_all_sides[prepared.sequence.solids.solids == Solid.BODY].all()
    some = np.arange(len(prepared.same_from_all_sides)) % 2 == 0
    trained, _ = train_surfels(settings, prepared._replace(same_from_all_sides=some))
    harmonics = np.abs(trained.harmonics.detach().numpy())
    assert harmonics[some[trained.binding]].max() == 0 and harmonics[~some[trained.binding]].max() > 0
