"""Enlarged noses: a warp with a known magnification and a known shift."""

import numpy as np
import pytest

from carigs.editing.drawn_nose import GROWTH, REACH, DrawnNose, magnified

CENTRE, RADIUS = np.array([40.3, 30.8]), 20.0
X, Y = np.meshgrid(np.arange(80) + 0.5, np.arange(64) + 0.5)
RAMPS = np.stack([X / 100, Y / 100, 0.4 + 0.002 * X - 0.003 * Y], axis=-1).astype(np.float32)
"""Colours that are affine in the position: bilinear sampling reproduces them, so an image of them says where its
pixels come from."""


def test_outside_the_disc_nothing_changes():
    image = magnified(RAMPS, CENTRE, RADIUS, 1.5, np.array([3.0, -2.0]))
    outside = np.hypot(X - CENTRE[0], Y - CENTRE[1]) >= RADIUS
    np.testing.assert_array_equal(image[outside], RAMPS[outside])
    assert np.abs(image - RAMPS)[~outside].max() > 0.02


@pytest.mark.parametrize("growth", [1.2, 1.5, 2.0])
def test_the_middle_is_magnified_and_stays_where_it_is(growth):
    source = 100 * magnified(RAMPS, CENTRE, RADIUS, growth, np.zeros(2))[..., :2]
    row, column = 30, 40  # the pixel of the centre
    middle = source[row, column] + (CENTRE - [column + 0.5, row + 0.5]) / growth
    np.testing.assert_allclose(middle, CENTRE, atol=0.02)
    around = source[row, column + 1] - source[row, column - 1]
    np.testing.assert_allclose(around, [2 / growth, 0], atol=0.02)


@pytest.mark.parametrize("moved", [(0.0, 0.0), (2.0, 0.0), (-3.0, 4.0), (0.0, 5.0)])
def test_what_is_in_the_middle_moves_by_what_is_asked(moved):
    source = 100 * magnified(RAMPS, CENTRE, 100.0, 1.5, np.array(moved))[..., :2]  # a wide disc: few pixels of rise
    distance = np.hypot(*np.moveaxis(source - CENTRE, -1, 0))
    row, column = np.unravel_index(distance.argmin(), distance.shape)
    np.testing.assert_allclose(np.array([column, row]) + 0.5, CENTRE + moved, atol=0.9)


def test_the_edit_does_not_fold():
    """Positions from which neighbours come stay in order."""
    source = 100 * magnified(RAMPS, CENTRE, RADIUS, GROWTH, np.array([5.0, 0.0]))
    assert (np.diff(source[..., 0], axis=1) > -1e-4).all() and (np.diff(source[..., 1], axis=0) > -1e-4).all()


def test_only_what_is_around_the_nose_changes(capture, view):
    shown = view()
    edited = DrawnNose(capture.model)(shown)
    corners = shown.camera.project(shown.vertices[capture.model.regions["nose"]])[0]
    centre, radius = corners.mean(axis=0), REACH * np.ptp(corners, axis=0).max()
    rows, columns = np.nonzero((edited != shown.captured).any(axis=-1))
    assert len(rows) > 50
    distance = np.hypot(columns + 0.5 - centre[0], rows + 0.5 - centre[1])
    assert distance.max() < radius + 2


def test_a_view_has_its_own_direction_and_always_the_same_one(capture, view):
    editor = DrawnNose(capture.model, drift=3.0)
    first, second = view(0), view(1)
    assert first.frame.camera != second.frame.camera
    edits = [editor(one) for one in (first, first, second)]
    np.testing.assert_array_equal(edits[0], edits[1])
    still = [DrawnNose(capture.model)(one) for one in (first, second)]
    assert (edits[0] != still[0]).any() and (edits[2] != still[1]).any()
    # What is rendered does not count, and another training has other directions.
    np.testing.assert_array_equal(editor(view(0, rendered=np.zeros_like(first.captured), seed=(9,))), edits[0])
    assert (DrawnNose(capture.model, drift=3.0, seed=1)(first) != edits[0]).any()


def test_a_view_without_a_nose_stays_as_it_is(capture, view):
    behind = view()
    turned = behind._replace(vertices=behind.vertices * [-1, 1, -1])
    np.testing.assert_array_equal(DrawnNose(capture.model)(turned), turned.captured)
