"""Copies of seen hair on the back of a head that cameras see from the front."""

from dataclasses import replace

import numpy as np
import pytest
from splat.training.initial_surfels.test_unseen_skin import SETTINGS, ball, everywhere, hair_everywhere

from carigs.mesh.triangle_mesh import barycenters, face_areas
from carigs.raster import compute_visibility
from carigs.splat.training.initial_surfels.grafted_hair import CONTRAST, GraftedHair, down_bases
from carigs.splat.training.initial_surfels.initialization import initial_surfels
from carigs.splat.training.subject import prepare_subject
from carigs.splat.training.trainer import train_surfels


@pytest.fixture(scope="module")
def from_front(tmp_path_factory):
    return ball(tmp_path_factory.mktemp("front") / "ball")


def test_hair_is_copied_to_the_scalp_that_no_frame_shows(from_front, monkeypatch):
    """As densely, no higher, with the same angle to the scalp and to the way down."""
    capture, path = from_front
    monkeypatch.setattr(type(capture), "foreground", everywhere)
    subject = prepare_subject(capture, path, SETTINGS, hair_everywhere(capture))
    seen, grafts, unseen, rig = subject.hair.points, subject.hair.grafts, subject.unseen, subject.sequence.rig
    copies, sources = grafts.points, seen.face[grafts.source]
    assert (unseen.kept & unseen.scalp)[copies.face].all() and unseen.well_seen[sources].all()
    area = face_areas(rig.vertices, rig.faces)
    known, bare = unseen.well_seen & unseen.scalp, unseen.kept & unseen.scalp
    density = known[seen.face].sum() / area[known].sum()
    assert len(copies.face) == pytest.approx(density * area[bare].sum(), rel=0.01)
    bases, centres = down_bases(rig), barycenters(rig.vertices, rig.faces)
    np.testing.assert_allclose(np.linalg.det(bases), 1, atol=1e-6)

    def above(points, face):
        return np.einsum("nc,nc->n", points - centres[face], bases[face, :, 2])

    highest = above(seen.position[grafts.source], sources)
    assert (above(copies.position, copies.face) <= highest + 1e-6).all() and highest.max() > 0.02
    lying = np.einsum("nca,nc->na", bases[copies.face], copies.axes[..., 0])
    np.testing.assert_allclose(
        lying, np.einsum("nca,nc->na", bases[sources], seen.axes[grafts.source][..., 0]), atol=1e-6
    )


def test_no_copy_stands_before_the_background_of_a_frame(from_front):
    """The mattes of the ball show none of the hair: rendered alone, copies are seen inside of them."""
    capture, path = from_front
    subject = prepare_subject(capture, path, SETTINGS, hair_everywhere(capture))
    sequence, (points, _, height) = subject.sequence, subject.hair.grafts
    assert (height[subject.unseen.kept & subject.unseen.scalp] == 0).any()
    for frame in capture.split("train"):
        centre = sequence.motion(frame.timestep, 0.0).centre[points.face]
        rest = barycenters(sequence.rig.vertices, sequence.rig.faces)[points.face]
        jacobian = sequence.motion(frame.timestep, 0.0).jacobian[points.face]
        placed = centre + np.einsum("nij,nj->ni", jacobian, points.position - rest)
        camera = capture.camera(frame)
        pixel, depth = camera.project(placed)
        mesh = compute_visibility(sequence.posed(frame.timestep, 0.0), sequence.rig.faces, camera)
        column, row = pixel.astype(int).T
        inside = (pixel >= 0).all(axis=1) & (column < camera.width) & (row < camera.height)
        column, row = column[inside], row[inside]
        before = depth[inside] * mesh.inverse_depth[row, column] < 1
        assert capture.foreground(frame)[row, column][before].min(initial=1) > 0.9


def test_copies_take_no_place_of_surfels_that_learn(from_front, monkeypatch):
    capture, path = from_front
    monkeypatch.setattr(type(capture), "foreground", everywhere)
    subject = prepare_subject(capture, path, SETTINGS, hair_everywhere(capture))
    copies = subject.hair.copies
    start = initial_surfels(SETTINGS, subject.supervision, subject.sequence, subject.hair, (), subject.unseen)
    settings = replace(SETTINGS, density=replace(SETTINGS.density, max_surfels=len(start) - copies + 50))
    trained, _ = train_surfels(settings, subject)
    assert copies > 100 and len(start) < len(trained) <= len(start) + 50


def test_copies_have_the_contrast_of_their_sources():
    grafts = GraftedHair(None, np.array([0, 1, 2, 2]), np.zeros(0))
    seen, face = np.array([[0.2, 0.2, 0.2], [0.4, 0.4, 0.4], [0.7, 0.6, 0.5]]), np.array([3, 3, 5])
    around = np.full((4, 3), 0.5)
    expected = 0.5 + CONTRAST * np.array([[-0.1], [0.1], [0.0], [0.0]])  # the third is alone on its triangle
    np.testing.assert_allclose(grafts.colours(around, seen, face), np.broadcast_to(expected, (4, 3)), atol=1e-12)
