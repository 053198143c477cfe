"""Surfels of hair hang on the scalp; those of covered skin stay on it and keep their colours."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from miniature import write_ball
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from carigs.capture import read_dataset
from carigs.errors import InputError
from carigs.exaggeration.gamma_path import straight_path
from carigs.hair import FoundHair
from carigs.hair.hull import Voxels
from carigs.hair.placement import MAX_ELONGATION
from carigs.hair.strands import Strands
from carigs.hair.views import WIDE
from carigs.head import neutral
from carigs.settings import Density, Train
from carigs.splat.avatar import Avatar, load_avatar, save_avatar
from carigs.splat.colour.spherical_harmonics import SH_BASE
from carigs.splat.rig.head_sequence import head_sequence
from carigs.splat.training.initial_surfels.hair_surfels import (
    COVERED_POSITION,
    COVERED_SCALE,
    FADING,
    HIDDEN_OPACITY,
    OPAQUE,
    keep_size_of_brows,
    prepare_hair,
)
from carigs.splat.training.initial_surfels.initialization import initial_surfels, start_distances
from carigs.splat.training.initial_surfels.view_spread import are_far_apart
from carigs.splat.training.subject import TrainingSubject
from carigs.splat.training.supervision import Supervision
from carigs.splat.training.trainer import train_surfels

SETTINGS = Train(iterations=12, gtstar_probability=0.0, hair_layers=3, sh_degree=1, density=Density(every=0))


@pytest.fixture
def subject(tmp_path):
    """The ball with a layer of hair 3 cm above its scalp, which covers a band of the skin below the scalp."""
    folder = write_ball(tmp_path / "ball")
    capture = read_dataset(folder, folder / "head_model.npz")
    rest, faces = neutral(capture.model, capture.parameters(0)), capture.model.faces
    sequence = head_sequence(capture, straight_path(rest, faces, rest * [0.3, 0, 0], 0.25))
    scalp, height = capture.model.face_region("scalp"), rest[faces].mean(axis=1)[:, 1]
    covered = scalp | (height > 0.03)
    centres = (1.3 * rest[rest[:, 1] > 0.04]).astype(np.float32)
    ones = np.ones(len(centres), np.float32)
    outwards = centres / np.linalg.norm(centres, axis=1, keepdims=True)
    down = np.array([0, -1, 1e-3]) + outwards * (outwards[:, 1:2] - 1e-3 * outwards[:, 2:])
    strands = Strands((down / np.linalg.norm(down, axis=1, keepdims=True)).astype(np.float32), 0.5 * ones, outwards)
    found = FoundHair(
        np.where(covered, 0.1, 0).astype(np.float32), covered, covered, ~covered,
        Voxels(centres, ones, 0.004), ones, strands,
    )  # fmt: skip
    return capture, sequence, found, scalp


def test_points_are_drawn_by_the_seed_and_a_bald_head_has_none(subject):
    _, sequence, found, scalp = subject
    hair = prepare_hair(found, scalp, sequence, SETTINGS)
    assert len(hair.points.face) == 3 * scalp.sum() and scalp[hair.points.face].all()
    np.testing.assert_array_equal(hair.covered, found.covered & ~scalp)
    same, other = (
        prepare_hair(found, scalp, sequence, replace(SETTINGS, seed=seed)).points.position for seed in (0, 1)
    )
    np.testing.assert_array_equal(same, hair.points.position)
    assert not np.array_equal(other, hair.points.position)
    sequence.smooth = None
    assert prepare_hair(found, scalp, sequence, replace(SETTINGS, hair_layers=0)) is None and sequence.smooth is None
    bald = replace(found, covered=found.covered & ~scalp, hidden=found.hidden & ~scalp)
    assert prepare_hair(bald, scalp, sequence, SETTINGS) is None
    distances = start_distances(sequence.rig, [hair.points])
    assert (distances[~scalp] == 0).all() and distances[np.unique(hair.points.face)].min() > 0


def test_first_surfels_lie_along_the_strands(subject):
    capture, sequence, found, scalp = subject
    hair = prepare_hair(found, scalp, sequence, SETTINGS)
    start, rig = initial_surfels(SETTINGS, Supervision(capture), sequence, hair), sequence.rig
    scale = start.log_scale.detach().exp().numpy()
    mine = scale[:, 0] > 1.5 * scale[:, 1]
    assert mine.sum() == len(hair.points.face) and scalp[start.binding[mine]].all()
    np.testing.assert_allclose((scale[:, 0] / scale[:, 1])[mine], 1 + 0.5 * (MAX_ELONGATION - 1), rtol=1e-4)
    face, local = start.binding[mine], start.position.detach().numpy()[mine]
    turn = Rotation.from_quat(start.rotation.detach().numpy()[mine], scalar_first=True).as_matrix()
    frame = rig.frame[face] / rig.scale[face, None, None]  # = R
    along, across = (np.einsum("nij,nj->ni", frame, turn[:, :, k]) for k in (0, 1))
    position = rig.vertices[rig.faces[face]].mean(axis=1) + np.einsum("nij,nj->ni", rig.frame[face], local) * 1.0
    outwards = position / np.linalg.norm(position, axis=1, keepdims=True)
    assert np.abs(np.einsum("nc,nc->n", along, outwards)).max() < 0.2  # the strands hang down along a sphere
    assert np.median(np.abs(along[:, 1])) > 0.5
    # Their discs face outwards.
    normal = np.cross(along, across)
    assert np.abs(np.einsum("nc,nc->n", normal, outwards)).min() > 0.9


def test_between_views_that_are_far_apart_hair_starts_opaque_and_filled(subject):
    """Points lie in voxels that no view sees, too, and views are far apart where two cameras are."""
    capture, sequence, found, scalp = subject
    seen = (np.arange(len(found.visible)) % 2).astype(np.float32)
    found = replace(found, visible=seen)
    counts = {}
    for is_between in (False, True):
        hair = prepare_hair(found, scalp, sequence, SETTINGS, None, is_between)
        _, voxel = cKDTree(found.volume.centres).query(hair.points.position)
        counts[is_between] = np.bincount(seen[voxel].astype(int), minlength=2)
        start = initial_surfels(SETTINGS, Supervision(capture), sequence, hair)
        opacity = torch.sigmoid(start.opacity.detach()).numpy()[scalp[start.binding]]
        assert np.isclose(opacity, OPAQUE, atol=1e-6).sum() == is_between * len(hair.points.face)
    assert counts[False][0] == 0 and 0 < counts[True][0] < counts[True][1]


def test_two_cameras_are_far_apart_if_the_angle_between_them_is_wide(subject):
    capture, sequence, *_ = subject
    frame, middle = capture.split("train")[0], sequence.posed(0, 0.0).mean(axis=0)

    def turned(degrees):
        camera = capture.camera(frame)
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_euler("y", degrees, degrees=True).as_matrix()
        turn[:3, 3] = middle - turn[:3, :3] @ middle
        return replace(camera, camera_from_world=camera.camera_from_world @ np.linalg.inv(turn))

    for degrees in (0, 0.8 * WIDE, 1.2 * WIDE):
        cameras = tuple(turned(angle) for angle in (0, degrees))
        frames = tuple(replace(frame, camera=i, calibration=i) for i in (0, 1))
        pair = replace(capture, frames=frames, calibrations=cameras)
        assert are_far_apart(pair, sequence) == (degrees > WIDE)


@pytest.mark.parametrize("backend", ["cpu", "torch"])
def test_covered_skin_starts_with_the_colour_of_the_skin_around_it_and_keeps_it(subject, tmp_path, backend):
    capture, sequence, found, scalp = subject
    hair = prepare_hair(found, scalp, sequence, SETTINGS)
    supervision = Supervision(capture)
    start = initial_surfels(SETTINGS, supervision, sequence, hair)
    plain = initial_surfels(SETTINGS, supervision, sequence, None)
    n = len(plain)
    assert len(start) == n + len(hair.points.face)
    colours = start.colour.detach().numpy()
    hidden = hair.covered[start.binding]
    # The green of the ball is 0.5 + 4 y: the band takes that of the skin below it, at a height of 0.03 m.
    front = hair.covered & (sequence.rig.vertices[sequence.rig.faces].mean(axis=1)[:, 2] > 0.06)
    own, green = (0.5 + SH_BASE * each.colour.detach().numpy()[front[each.binding], 1] for each in (plain, start))
    assert np.ptp(own) > 0.08 and np.abs(own - 0.62).max() > 0.1
    np.testing.assert_allclose(green, 0.62, atol=0.05)
    settings = replace(SETTINGS, backend=backend)
    trained, _ = train_surfels(settings, TrainingSubject(sequence, supervision, hair))
    np.testing.assert_array_equal(trained.colour.detach().numpy()[hidden], colours[hidden])
    assert not np.array_equal(trained.colour.detach().numpy()[~hidden], colours[~hidden])
    for each in (start, trained):
        np.testing.assert_allclose(torch.sigmoid(each.opacity).detach().numpy()[hidden], HIDDEN_OPACITY, atol=1e-6)
    inside = hair.covered[trained.binding]
    assert np.linalg.norm(trained.position.detach().numpy()[inside], axis=1).max() <= COVERED_POSITION + 1e-5
    assert np.exp(trained.log_scale.detach().numpy()[inside]).max() <= COVERED_SCALE + 1e-5


def test_hair_over_bare_skin_fades_and_other_surfels_do_not(subject):
    capture, sequence, found, scalp = subject
    hair, rig = prepare_hair(found, scalp, sequence, SETTINGS), sequence.rig
    surfels = initial_surfels(SETTINGS, Supervision(capture), sequence, hair)
    before = surfels.opacity.detach().numpy().copy()
    hair.fade_over_bare_skin(surfels, rig)
    np.testing.assert_array_equal(surfels.opacity.detach().numpy(), before)  # hair starts where hair is
    # The first surfel of the hair goes 4 mm above a bare triangle.
    mine = int(np.flatnonzero(scalp[surfels.binding])[0])
    face, bare = surfels.binding[mine], int(np.flatnonzero(~(scalp | found.covered))[50])
    centres = rig.vertices[rig.faces].mean(axis=1)
    goal = centres[bare] + 0.004 * rig.frame[bare, :, 2] / np.linalg.norm(rig.frame[bare, :, 2])
    local = np.linalg.solve(rig.frame[face], goal - centres[face])
    surfels.position.detach().numpy()[mine] = local
    hair.fade_over_bare_skin(surfels, rig)
    change = surfels.opacity.detach().numpy() - before
    assert change[mine] == pytest.approx(-FADING) and np.count_nonzero(change) == 1


@pytest.mark.parametrize("grows", [False, True])
def test_an_avatar_keeps_the_motion_of_its_hair(subject, tmp_path, grows):
    capture, sequence, found, scalp = subject
    hair = prepare_hair(found, scalp, sequence, replace(SETTINGS, hair_grows=grows))
    surfels = initial_surfels(SETTINGS, Supervision(capture), sequence, hair)
    avatar, file = Avatar(surfels, sequence), tmp_path / "avatar.npz"
    save_avatar(file, avatar)
    again, camera = load_avatar(file), capture.cameras[1]
    image = avatar.render(1, 0.25, camera)
    np.testing.assert_allclose(again.render(1, 0.25, camera), image, atol=1e-5)
    with np.load(file) as arrays:  # as avatars of before were written
        np.savez(tmp_path / "older.npz", **{name: arrays[name] for name in arrays if name != "hair_grows"})
    older = load_avatar(tmp_path / "older.npz").render(1, 0.25, camera)
    assert np.allclose(older, image, atol=1e-5) != grows
    again.sequence.smooth = None
    again.sequence._motions.clear()
    assert np.abs(again.render(1, 0.25, camera) - image).max() > 0.01


def with_brows(sequence):
    """The same subject with a head model that says where its brows are: on the front of the ball."""
    _, y, z = sequence.head.v_template.T
    vertices = np.flatnonzero((z > 0.03) & (np.abs(y) < 0.05))
    assert len(vertices)
    sequence.head = replace(sequence.head, regions={**sequence.head.regions, "brows": vertices})
    return sequence


def test_brows_keep_their_size_unless_hair_grows(subject, tmp_path):
    capture, sequence, _, _ = subject
    keep_size_of_brows(sequence, SETTINGS)
    assert not sequence.rig.keeps_size.any()  # the model does not say where the brows are
    with_brows(sequence)
    keep_size_of_brows(sequence, replace(SETTINGS, hair_grows=True))
    assert not sequence.rig.keeps_size.any()
    surfels, camera = initial_surfels(SETTINGS, Supervision(capture), sequence, None), capture.cameras[1]
    stretched = Avatar(surfels, sequence).render(1, 0.25, camera)
    keep_size_of_brows(sequence, SETTINGS)
    np.testing.assert_array_equal(sequence.rig.keeps_size, sequence.head.face_region("brows"))
    image = Avatar(surfels, sequence).render(1, 0.25, camera)
    assert np.abs(image - stretched).max() > 0.01
    save_avatar(tmp_path / "avatar.npz", Avatar(surfels, sequence))
    again = load_avatar(tmp_path / "avatar.npz")
    np.testing.assert_array_equal(again.sequence.rig.keeps_size, sequence.rig.keeps_size)
    np.testing.assert_allclose(again.render(1, 0.25, camera), image, atol=1e-5)
    with np.load(tmp_path / "avatar.npz") as arrays:
        np.savez(tmp_path / "short.npz", **{**arrays, "keeps_size": arrays["keeps_size"][:-1]})
    with pytest.raises(InputError, match="keeps_size"):
        load_avatar(tmp_path / "short.npz")
