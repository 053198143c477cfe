"""The back of a head that cameras see from the front."""

from dataclasses import replace

import numpy as np
import pytest
from miniature import ball_cameras, ball_model, write_ball

from carigs.capture import Camera, look_at, read_dataset
from carigs.capture.splits import ENOUGH_CAMERAS
from carigs.exaggeration.gamma_path import straight_path
from carigs.hair import FoundHair
from carigs.hair.hull import Voxels
from carigs.hair.strands import Strands
from carigs.head import neutral
from carigs.mesh.triangle_mesh import barycenters, boundary_vertices
from carigs.raster import rasterize_mesh
from carigs.settings import Density, Train
from carigs.settings.regions import Regions
from carigs.splat.colour.spherical_harmonics import SH_BASE
from carigs.splat.rig.head_sequence import head_sequence
from carigs.splat.surfels.surfels import to_arrays
from carigs.splat.training import subject
from carigs.splat.training.initial_surfels.initialization import initial_surfels
from carigs.splat.training.initial_surfels.observed_colours import observed_colours
from carigs.splat.training.initial_surfels.unseen_skin import (
    COVERING,
    KEPT_SCALE,
    LEFT_OUT,
    LIFTED_SCALE,
    UNSEEN,
    WELL_SEEN,
    find_unseen_skin,
    look_at_triangles,
)
from carigs.splat.training.subject import prepare_subject
from carigs.splat.training.supervision import Example, Supervision
from carigs.splat.training.trainer import train_surfels

SETTINGS = Train(
    iterations=30, gtstar_probability=0.0, hair_layers=3, cover_unseen="all",
    density=Density(start=5, stop=25, every=5, reset_every=10, gradient_threshold=1e-7, max_surfels=1600),
)  # fmt: skip
HAIR, SKIN = np.array([0.2, 0.15, 0.1]), np.array([0.8, 0.6, 0.5])


def ball(folder, cameras=None):
    """A capture of the ball and its caricatures."""
    write_ball(folder, cameras=cameras)
    capture = read_dataset(folder, folder / "head_model.npz")
    rest = neutral(capture.model, capture.parameters(0))
    return capture, straight_path(rest, capture.model.faces, rest * 0.1, 0.25)


@pytest.fixture(scope="module")
def from_front(tmp_path_factory):
    return ball(tmp_path_factory.mktemp("front") / "ball")


def hair_everywhere(capture):
    """A layer of hair 3 cm above the scalp."""
    model = capture.model
    rest, faces = neutral(model, capture.parameters(0)), model.faces
    scalp, nothing = model.face_region("scalp"), np.zeros(len(faces), bool)
    centres = (1.3 * rest[rest[:, 1] > 0.06]).astype(np.float32)
    ones = np.ones(len(centres), np.float32)
    strands = Strands(*(np.tile(np.float32(axis), (len(centres), 1)) for axis in ([0, -1, 0],)), 0 * ones,
                      np.tile(np.float32([0, 0, 1]), (len(centres), 1)))  # fmt: skip
    texture = np.where(scalp, 0.1, 0).astype(np.float32)
    return FoundHair(texture, scalp, nothing, ~scalp, Voxels(centres, ones, 0.004), ones, strands)


def test_cameras_in_front_see_the_front(from_front):
    capture, path = from_front
    sequence = prepare_subject(capture, path, SETTINGS).sequence
    sight = look_at_triangles(capture, sequence)
    depth = sequence.rig.vertices[sequence.rig.faces].mean(axis=1)[:, 2]
    assert sight.cosine[depth > 0.08].min() > WELL_SEEN and sight.matte[depth > 0.08].min() == 1
    skin = find_unseen_skin(capture, sequence, Regions())
    assert skin.faces[depth < -0.06].all() and not skin.faces[depth > 0.07].any()
    assert (skin.faces == (sight.cosine <= UNSEEN)).all()  # a ball has no inside
    beside = np.isin(sequence.rig.faces, sequence.rig.faces[~skin.faces]).any(axis=1)
    assert skin.kept[depth < -0.09].all() and not skin.kept[beside].any()


def test_teeth_are_not_skin(from_front, monkeypatch):
    """A closed mouth hides them, and the skin around does not tell their colours."""
    capture, path = from_front
    sequence = prepare_subject(capture, path, SETTINGS).sequence
    back = np.flatnonzero(sequence.rig.vertices[:, 2] < -0.08)
    monkeypatch.setitem(sequence.head.regions, "teeth", back)
    skin, teeth = find_unseen_skin(capture, sequence, Regions()), sequence.head.face_region("teeth")
    assert teeth.any() and not skin.faces[teeth].any() and skin.faces[~teeth].any()


def test_nothing_changes_where_frames_show_all(tmp_path):
    width, height = ball_cameras()[0].width, ball_cameras()[0].height
    places = [(0, 0, 1), (0, 0, -1), (1, 0, 0.1), (-1, 0, 0.1), (0, 1, 0.1), (0, -1, 0.1), (0, 0.1, 1)]
    order = [0, 6, 1, 2, 3, 4, 5]  # camera 1 is for validation
    cameras = {
        i: Camera(look_at(np.array(places[k], float), np.zeros(3)), 150, 150, width / 2, height / 2, width, height)
        for i, k in enumerate(order)
    }
    capture, path = ball(tmp_path / "ball", cameras)
    trained = []
    for covers in ("all", "none"):
        settings = replace(SETTINGS, cover_unseen=covers)
        subject = prepare_subject(capture, path, settings, hair_everywhere(capture))
        assert subject.unseen is None and subject.supervision.kept is None
        trained.append(to_arrays(train_surfels(settings, subject)[0]))
    for name, values in trained[0].items():
        np.testing.assert_array_equal(values, trained[1][name])


def test_discs_cover_the_back_in_colours_of_the_front(from_front):
    capture, path = from_front
    subject = prepare_subject(capture, path, SETTINGS)
    start = initial_surfels(SETTINGS, subject.supervision, subject.sequence, unseen=subject.unseen)
    plain = initial_surfels(SETTINGS, subject.supervision, subject.sequence)
    back = subject.unseen.faces[start.binding]
    arrays, before = to_arrays(start), to_arrays(plain)
    np.testing.assert_array_equal(np.unique(start.binding[back]), np.flatnonzero(subject.unseen.faces))
    np.testing.assert_allclose(1 / (1 + np.exp(-arrays["opacity"][back])), COVERING, atol=1e-6)
    for name, values in before.items():
        np.testing.assert_array_equal(arrays[name][~back], values[~back])
    rgb, kept = 0.5 + SH_BASE * arrays["colour"], subject.unseen.kept[start.binding]
    assert (rgb[kept] >= rgb[~back].min(axis=0) - 1e-6).all() and (rgb[kept] <= rgb[~back].max(axis=0) + 1e-6).all()


def test_the_scalp_is_covered_before_few_cameras(from_front, monkeypatch):
    """Of the hair, many cameras see most."""
    capture, path = from_front
    scalp = capture.model.face_region("scalp")
    by_default = replace(SETTINGS, cover_unseen=Train().cover_unseen)
    assert len({frame.camera for frame in capture.split("train")}) < ENOUGH_CAMERAS
    assert (prepare_subject(capture, path, by_default).unseen.kept & scalp).any()
    monkeypatch.setattr(subject, "ENOUGH_CAMERAS", 1)
    assert not (prepare_subject(capture, path, by_default).unseen.kept & scalp).any()


def test_skin_alone_can_be_covered(from_front):
    capture, path = from_front
    skin = prepare_subject(capture, path, replace(SETTINGS, cover_unseen="skin")).unseen
    scalp = capture.model.face_region("scalp")
    np.testing.assert_array_equal(skin.faces, prepare_subject(capture, path, SETTINGS).unseen.faces & ~scalp)
    assert skin.kept.any() and not (skin.kept & scalp).any()


def discs(start, kept):
    """Which surfels are discs on triangles that the training leaves as they are, and not copies of hair."""
    opacity = 1 / (1 + np.exp(-to_arrays(start)["opacity"].astype(float)))
    return kept[start.binding] & np.isclose(opacity, COVERING, atol=1e-6)


def test_discs_overlap_more_where_they_are_lifted(from_front):
    capture, path = from_front
    subject = prepare_subject(capture, path, SETTINGS, hair_everywhere(capture))
    start = initial_surfels(SETTINGS, subject.supervision, subject.sequence, subject.hair, (), subject.unseen)
    kept = discs(start, subject.unseen.kept)
    scale, lifted = np.exp(to_arrays(start)["log_scale"][kept]), subject.unseen.scalp[start.binding[kept]]
    np.testing.assert_allclose(scale[lifted], LIFTED_SCALE, rtol=1e-5)
    np.testing.assert_allclose(scale[~lifted], KEPT_SCALE, rtol=1e-5)
    assert lifted.any() and not lifted.all()


def test_the_border_of_a_mesh_is_trained(tmp_path):
    """A ball without its lowest part, seen from the front: no camera sees the border at its back."""
    whole = ball_model()
    model = replace(whole, faces=whole.faces[(whole.v_template[whole.faces, 1] > -0.07).all(axis=1)])
    write_ball(tmp_path / "open", model=model)
    capture = read_dataset(tmp_path / "open", tmp_path / "open" / "head_model.npz")
    rest = neutral(capture.model, capture.parameters(0))
    sequence = head_sequence(capture, straight_path(rest, capture.model.faces, rest * 0.1, 0.25))
    faces = sequence.rig.faces
    border = boundary_vertices(faces, len(rest))[faces].any(axis=1)
    skin = find_unseen_skin(capture, sequence, Regions())
    assert (skin.faces & border).any() and not (skin.kept & border).any()


def test_hair_continues_as_hair_and_skin_as_skin(from_front):
    capture, path = from_front
    unseen = prepare_subject(capture, path, SETTINGS).unseen
    scalp = capture.model.face_region("scalp")
    colours = np.where(scalp[:, None], HAIR, SKIN)
    garbled = np.where(unseen.faces[:, None], [0.1, 0.9, 0.2], colours)
    np.testing.assert_allclose(unseen.continued(garbled, np.ones(len(scalp), bool)), colours, atol=1e-6)
    only_skin = unseen.continued(garbled, ~scalp)  # no frame shows hair: it takes the colours of the skin around
    np.testing.assert_allclose(only_skin[unseen.faces], np.tile(SKIN, (unseen.faces.sum(), 1)), atol=1e-6)


def test_skin_below_the_hairline_does_not_colour_the_back_of_the_head(from_front):
    """Frames that show bare skin on the lowest 40 % of the seen scalp, down to where no frame looks."""
    capture, path = from_front
    subject = prepare_subject(capture, path, SETTINGS, hair_everywhere(capture))
    sequence, unseen, rig = subject.sequence, subject.unseen, subject.sequence.rig
    centres, scalp = barycenters(rig.vertices, rig.faces), unseen.scalp
    hairline = np.percentile(centres[scalp & unseen.well_seen, 1], 40)
    shown = np.vstack([np.where((scalp & (centres[:, 1] > hairline))[:, None], HAIR, SKIN), [1, 1, 1]])
    views = []
    for frame in capture.split("train"):
        camera = capture.camera(frame)
        face = rasterize_mesh(sequence.posed(frame.timestep, 0.0), rig.faces, camera).face
        image = shown[face].astype(np.float32)
        views.append((Example(frame.timestep, camera, 0.0, image, None), np.ones(face.shape)))
    binding = np.tile(np.arange(len(rig.faces)), 2)
    position = np.zeros((len(binding), 3))
    position[len(rig.faces) :, 2] = 0.01  # of hair, just above the scalp
    rgb = observed_colours(binding, position, sequence, views, subject.hair, unseen)[: len(rig.faces)]
    back = unseen.faces & scalp
    away = abs(rgb[back] - HAIR).max(axis=1)
    assert back.sum() > 20 and np.median(away) < 0.15 and away.max() < 0.5 * abs(SKIN - HAIR).max()
    without = observed_colours(binding, position, sequence, views, None, unseen)[: len(rig.faces)]
    assert np.median(abs(without[back] - HAIR).max(axis=1)) > 2 * np.median(away)


def test_skin_beyond_the_matte_is_left_out(from_front, monkeypatch):
    """A matte that ends at a collar, which cuts the lower part of the ball."""
    capture, path = from_front
    sequence = prepare_subject(capture, path, SETTINGS).sequence
    foreground = type(capture).foreground

    def cut(self, frame):
        matte = foreground(self, frame).copy()
        matte[matte.shape[0] * 55 // 100 :] = 0
        return matte

    monkeypatch.setattr(type(capture), "foreground", cut)
    unseen = find_unseen_skin(capture, sequence, Regions())
    height = sequence.rig.vertices[sequence.rig.faces].mean(axis=1)[:, 1]
    assert (unseen.opacity[unseen.faces & (height < -0.06)] == LEFT_OUT).all()
    assert (unseen.opacity[unseen.faces & (height > 0.04)] == COVERING).all()


def test_the_training_leaves_the_discs_as_they_are(from_front):
    """Also where density control splits and prunes all it can; hair hangs on triangles that frames show."""
    capture, path = from_front
    subject = prepare_subject(capture, path, SETTINGS, hair_everywhere(capture))
    kept = subject.unseen.kept
    assert kept.sum() > 300 and not kept[subject.hair.points.face].any()
    start = initial_surfels(SETTINGS, subject.supervision, subject.sequence, subject.hair, (), subject.unseen)
    trained, _ = train_surfels(SETTINGS, subject)
    before, after = to_arrays(start), to_arrays(trained)
    for name, values in before.items():
        np.testing.assert_array_equal(after[name][kept[trained.binding]], values[kept[start.binding]])
    assert len(trained) != len(start)


def test_discs_rise_to_half_the_height_of_the_hair_around(from_front, monkeypatch):
    """Hair 3 cm thick: the unseen scalp is covered below that, and lower towards the skin."""
    capture, path = from_front
    monkeypatch.setattr(type(capture), "foreground", everywhere)
    subject = prepare_subject(capture, path, SETTINGS, hair_everywhere(capture))
    unseen, rig = subject.unseen, subject.sequence.rig
    start = initial_surfels(SETTINGS, subject.supervision, subject.sequence, subject.hair, (), unseen)
    kept = discs(start, unseen.kept)
    height = to_arrays(start)["position"][kept, 2] * rig.scale[start.binding[kept]]
    scalp, beside = (
        unseen.scalp[start.binding[kept]],
        np.asarray(unseen.beside @ ~unseen.scalp)[start.binding[kept]] > 0,
    )
    assert np.abs(height[~scalp]).max() < 1e-6
    assert (height[scalp] > 0).all() and 0.0075 < height.max() < 0.0175
    assert height[scalp & beside].mean() < 0.7 * height[scalp & ~beside].mean()


def everywhere(capture, frame):
    """A matte of a frame that shows the subject everywhere."""
    camera = capture.camera(frame)
    return np.ones((camera.height, camera.width), np.float32)


def test_surfels_of_a_given_avatar_are_trained_everywhere(from_front):
    capture, path = from_front
    assert prepare_subject(capture, path, replace(SETTINGS, start="avatar.npz")).unseen is None
    assert Supervision(capture).example(False, 0).frozen is None
