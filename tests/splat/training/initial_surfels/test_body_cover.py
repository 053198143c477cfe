"""Discs over the sides of a body that no frame shows."""

from dataclasses import replace

import numpy as np
import pytest
from splat.training.initial_surfels.test_body_surfels import SETTINGS, TOY

from carigs.capture import Capture
from carigs.exaggeration import GammaPath
from carigs.hair import find_hair
from carigs.hair.body import Body
from carigs.hair.hull import Voxels
from carigs.head.neck_border import neck_border
from carigs.mesh.carried_points import CarriedPoints
from carigs.settings import Hair
from carigs.splat.rig.head_sequence import head_sequence
from carigs.splat.rig.solid_motion import Solid
from carigs.splat.surfels.surfels import to_arrays
from carigs.splat.training.initial_surfels import body_cover as module
from carigs.splat.training.initial_surfels.body_cover import OPACITY, BodyCover, cover_body
from carigs.splat.training.initial_surfels.grafted_hair import shown_as_background
from carigs.splat.training.initial_surfels.initialization import initial_surfels
from carigs.splat.training.subject import prepare_subject
from carigs.splat.training.trainer import train_surfels
from evaluation.benchmarks.measurement.toy_frames import write_subject

RADIUS, SIZE = 0.08, 0.004


@pytest.fixture(scope="module")
def subject(tmp_path_factory):
    """The toy, and a round body below its neck, whose front half frames show."""
    folder = tmp_path_factory.mktemp("toy")
    write_subject(folder, TOY)
    capture, path = Capture.load(folder / "capture.json"), GammaPath.load(folder / "path.npz")
    border = neck_border(capture.model, head_sequence(capture, path).rig.vertices)
    grid = np.stack(np.meshgrid(*[np.arange(-0.1, 0.1, SIZE)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    inside = grid[np.linalg.norm(grid, axis=1) < RADIUS]
    centre = border.centre - [0, 0.12, 0]
    visible = (inside[:, 2] > 0).astype(np.float32)
    body = Body(Voxels((centre + inside).astype(np.float32), np.ones(len(inside), np.float32), SIZE), visible)
    return capture, path, replace(find_hair(Hair(), capture), body=body), centre


def cover(subject, carriers=None):
    capture, path, found, _ = subject
    sequence = head_sequence(capture, path)
    border = neck_border(sequence.head, sequence.rig.vertices)
    carriers = border.carriers if carriers is None else carriers
    points = CarriedPoints(*(np.zeros(0, int) for _ in range(5)))
    return cover_body(found.body, points, carriers, capture, sequence), sequence


def test_discs_lie_on_the_hidden_half_of_the_surface_and_along_it(subject, monkeypatch):
    monkeypatch.setattr(module, "shown_as_background", lambda position, *_: np.zeros(len(position), bool))
    points = cover(subject)[0].points
    arm = points.position - subject[3]
    radius = np.linalg.norm(arm, axis=1)
    assert (radius > RADIUS - 2 * SIZE).all() and (radius < RADIUS + 1e-5).all() and (arm[:, 2] <= 1e-6).all()
    normal = np.cross(points.axes[..., 0], points.axes[..., 1])
    away_from_rim = arm[:, 2] < -0.01
    cosine = np.einsum("nc,nc->n", normal, arm)[away_from_rim] / radius[away_from_rim]
    assert np.abs(cosine).min() > 0.95
    np.testing.assert_allclose(
        points.axes.swapaxes(1, 2) @ points.axes, np.tile(np.eye(2), (len(arm), 1, 1)), atol=1e-9
    )
    # No place of the hidden half is farther from a disc than two cells of the grid are long.
    rng = np.random.default_rng(1)
    places = rng.normal(size=(500, 3)) * [1, 1, 0] - [0, 0, 1] * np.abs(rng.normal(size=(500, 1)))
    places = RADIUS * places / np.linalg.norm(places, axis=1, keepdims=True)
    gaps = np.linalg.norm(places[:, None] - arm, axis=2).min(axis=1)
    assert gaps.max() < 2 * module.GRID


def test_no_disc_stands_before_the_background_of_a_frame(subject, monkeypatch):
    """The toy's frames show background below its neck: cameras that look down see no body."""
    capture = subject[0]
    monkeypatch.setattr(module, "shown_as_background", lambda position, *_: np.zeros(len(position), bool))
    everywhere = cover(subject)[0].points
    monkeypatch.undo()
    covered, sequence = cover(subject)
    beside = shown_as_background(everywhere.position, everywhere.face, capture, sequence)
    assert beside.any()
    left = np.zeros((0, 3)) if covered is None else covered.points.position
    np.testing.assert_array_equal(left, everywhere.position[~beside])


def test_nothing_carries_a_cover_without_triangles_that_are_kept(subject):
    assert cover(subject, np.zeros(len(subject[0].model.faces), bool))[0] is None


def test_colours_are_medians_at_the_same_distance_from_the_middle():
    """A skin-coloured middle, a dark shirt beside it, and one white point in the shirt."""
    x = np.linspace(-0.2, 0.2, 401)
    position = np.stack([x, 0 * x, 0 * x + 0.1], axis=1)
    seen = np.where(np.abs(x)[:, None] < 0.04, [0.8, 0.6, 0.5], [0.1, 0.1, 0.2])
    seen[50] = 1.0
    nothing = (np.zeros(401), np.zeros((401, 3, 2)), np.ones(401))
    body = CarriedPoints(np.zeros(401, int), position, *nothing)
    back = body._replace(position=position * [1, 1, -1])
    colours = BodyCover(back, body).colours(seen)
    seen[50] = [0.1, 0.1, 0.2]
    away_from_edges = np.abs(np.abs(x) - 0.04) > 0.011
    np.testing.assert_allclose(colours[away_from_edges], seen[away_from_edges])


def test_a_training_leaves_them_as_they_are(subject, monkeypatch):
    """They hang on the triangles along the border that frames show worst, and move with the body."""
    monkeypatch.setattr(module, "shown_as_background", lambda position, *_: np.zeros(len(position), bool))
    capture, path, found, _ = subject
    settings = replace(SETTINGS, cover_unseen="all")
    prepared = prepare_subject(capture, path, settings, found)
    points, sequence = prepared.body_cover.points, prepared.sequence
    assert (sequence.solids.solids[points.face] == Solid.BODY).all() and prepared.unseen.kept[points.face].all()
    assert not prepared.unseen.kept[prepared.body.face].any()
    assert prepared.copies >= len(points.face) > 100
    start = initial_surfels(
        settings, prepared.supervision, sequence, prepared.hair, prepared.inside, prepared.unseen, prepared.body_cover
    )
    trained, _ = train_surfels(settings, prepared)
    for before, after in zip(to_arrays(start).values(), to_arrays(trained).values(), strict=True):
        mine = prepared.unseen.kept[start.binding]
        np.testing.assert_array_equal(before[mine], after[prepared.unseen.kept[trained.binding]])
    opacity = 1 / (1 + np.exp(-to_arrays(start)["opacity"]))
    mine = prepared.unseen.kept[start.binding] & (sequence.solids.solids[start.binding] == Solid.BODY)
    assert np.isclose(opacity[mine], OPACITY, atol=1e-5).sum() >= len(points.face)


def test_there_is_none_where_the_scalp_is_not_covered(subject):
    capture, path, found, _ = subject
    settings = replace(SETTINGS, cover_unseen="skin")
    assert prepare_subject(capture, path, settings, found).body_cover is None
