"""Regions to which edits are confined."""

import numpy as np
import pytest

from carigs.editing.region_mask import confined, edited_faces, edited_pixels
from carigs.errors import SettingsError
from carigs.raster import compute_visibility


def test_the_mask_is_one_on_the_region_and_falls_to_zero_around_it(capture, view):
    shown, faces = view(), edited_faces(capture.model, ("nose",))
    weight = edited_pixels(capture.model, shown.vertices, shown.camera, faces)
    face = compute_visibility(shown.vertices, capture.model.faces, shown.camera).face
    nose = (face >= 0) & faces[face]
    assert nose.any() and (weight[nose] == 1).all()
    assert weight.min() == 0 and 0 < np.mean(weight > 0) < 0.5
    assert (weight[~nose] == 1).any() and ((weight > 0) & (weight < 1)).any()  # a margin, and its edge
    assert (np.abs(np.diff(weight, axis=1)) < 0.9).all()


def test_a_view_that_shows_nothing_of_the_region_has_no_mask(capture, view):
    behind = view()
    faces = edited_faces(capture.model, ("nose",))
    assert not edited_pixels(capture.model, behind.vertices * [-1, 1, -1], behind.camera, faces).any()


def test_an_edit_outside_the_mask_is_lost_to_the_last_bit():
    random = np.random.default_rng(0)
    edited, captured = random.random((2, 9, 8, 3), dtype=np.float32)
    weight = np.zeros((9, 8), np.float32)
    weight[2:5, 3:6] = 1
    weight[5] = 0.25
    image = confined(edited, captured, weight)
    np.testing.assert_array_equal(image[weight == 0], captured[weight == 0])
    np.testing.assert_allclose(image[weight == 1], edited[weight == 1], atol=1e-7)
    np.testing.assert_allclose(image[5], 0.75 * captured[5] + 0.25 * edited[5], atol=1e-7)


def test_without_regions_edits_are_allowed_everywhere_and_an_unknown_one_is_named(capture):
    assert edited_faces(capture.model, ()) is None
    assert edited_faces(capture.model, ("nose", "face")).sum() > edited_faces(capture.model, ("nose",)).sum()
    with pytest.raises(
        SettingsError, match=r"train\.edit\.regions: the head model has no region horns; it has face, n"
    ):
        edited_faces(capture.model, ("nose", "horns"))
