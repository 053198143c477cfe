"""The back of a head that cameras see from the front."""

import numpy as np
import pytest
from miniature import write_ball

from carigs.capture import read_dataset
from carigs.exaggeration.gamma_path import straight_path
from carigs.head import neutral
from carigs.settings.regions import Regions
from carigs.splat.colour.spherical_harmonics import SH_BASE
from carigs.splat.rig.head_sequence import head_sequence
from carigs.splat.surfels.surfels import flat_discs, to_arrays
from carigs.splat.training.unseen_faces import ON_SKIN, complete_unseen, seen_faces

HAIR, SKIN, NOISE = np.array([0.2, 0.15, 0.1]), np.array([0.8, 0.6, 0.5]), np.array([0.1, 0.9, 0.2])


@pytest.fixture(scope="module")
def subject(tmp_path_factory):
    folder = tmp_path_factory.mktemp("ball")
    write_ball(folder)
    capture = read_dataset(folder, folder / "head_model.npz")
    rest = neutral(capture.model, capture.parameters(0))
    return capture, head_sequence(capture, straight_path(rest, capture.model.faces, rest * 0.1, 0.25))


def discs(subject, rgb, height=0.0):
    """One on each triangle."""
    capture, _ = subject
    count = len(capture.model.faces)
    position = np.zeros((count, 3))
    position[:, 2] = height
    return flat_discs(np.arange(count), position, np.full(count, 0.5), 0.8, np.broadcast_to(rgb, (count, 3)), 1)


def test_triangles_are_seen_from_the_front(subject):
    capture, sequence = subject
    seen = seen_faces(capture, sequence)
    vertices = sequence.posed(0, 0.0)
    depth = vertices[capture.model.faces].mean(axis=1)[:, 2]
    assert seen.cosine[depth > 0.08].min() > 0.5
    assert seen.cosine[depth < -0.03].max() < 0.2
    assert ((seen.matte >= 0) & (seen.matte <= 1)).all() and seen.matte[depth > 0.08].min() > 0.99


def test_the_back_has_the_colours_of_the_hair_and_of_the_skin_around(subject):
    capture, sequence = subject
    seen = seen_faces(capture, sequence)
    scalp = capture.model.face_region("scalp")
    front = seen.cosine > 0
    rgb = np.where(front[:, None], np.where(scalp[:, None], HAIR, SKIN), NOISE)
    trained = discs(subject, rgb)
    completed = complete_unseen(trained, capture, sequence, Regions())
    before, after = to_arrays(trained), to_arrays(completed)
    for name, values in before.items():  # what frames show stays as it is
        np.testing.assert_array_equal(after[name][seen.cosine[after["binding"]] >= 0.2], values[seen.cosine >= 0.2])
    back = seen.cosine[completed.binding] < 0.2
    colours = 0.5 + SH_BASE * after["colour"][back]
    expected = np.where(scalp[completed.binding[back], None], HAIR, SKIN)
    np.testing.assert_allclose(colours, expected, atol=1e-3)
    assert set(completed.binding) == set(trained.binding)
    assert after["opacity"][back].min() > before["opacity"].max()


def test_hair_that_stands_off_is_kept(subject):
    capture, sequence = subject
    high = discs(subject, SKIN, height=2 * ON_SKIN)
    completed = complete_unseen(high, capture, sequence, Regions())
    assert len(completed) > len(high)
    kept = np.linalg.norm(to_arrays(completed)["position"], axis=1) > ON_SKIN
    np.testing.assert_array_equal(completed.binding[kept], high.binding)
