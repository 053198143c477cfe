"""Values continued over the triangles of a mesh."""

import numpy as np
from surfaces import sphere

from carigs.hair.harmonic_faces import faces_beside, harmonic_faces


def test_unknown_values_are_means_of_those_beside_and_between_the_known_ones():
    _, faces = sphere(3)
    beside = faces_beside(faces)
    assert (beside.sum(axis=1) == 3).all()  # a closed surface
    rng = np.random.default_rng(0)
    known, values = rng.random(len(faces)) < 0.1, rng.random((len(faces), 2))
    filled = harmonic_faces(np.where(known[:, None], values, np.nan), known, beside)
    np.testing.assert_array_equal(filled[known], values[known])
    np.testing.assert_allclose(filled[~known], (beside @ filled / 3)[~known], atol=1e-7)
    assert filled.min() >= values[known].min() and filled.max() <= values[known].max()  # the maximum principle


def test_a_part_without_known_values_is_zero():
    _, faces = sphere(1)
    two = np.vstack([faces, faces + faces.max() + 1])
    known = np.arange(len(two)) == 0
    filled = harmonic_faces(np.full(len(two), 7.0), known, faces_beside(two))
    np.testing.assert_allclose(filled, np.where(np.arange(len(two)) < len(faces), 7, 0), atol=1e-5)
    assert harmonic_faces(np.ones(len(two)), np.ones(len(two), bool), faces_beside(two)).all()


def test_without_a_known_value_all_are_zero():
    _, faces = sphere(1)
    for values in (np.ones(len(faces)), np.ones((len(faces), 2))):
        assert not harmonic_faces(values, np.zeros(len(faces), bool), faces_beside(faces)).any()


def test_constants_and_linear_functions_continue_on_a_plane():
    """Inside a regular grid, the centre of a triangle is the mean of those beside: linear functions are harmonic."""
    n = 8
    row, column = np.divmod(np.arange(n * n), n)
    corner = np.flatnonzero((row < n - 1) & (column < n - 1))
    faces = np.concatenate([corner[:, None] + [0, 1, n + 1], corner[:, None] + [0, n + 1, n]])
    vertices = np.stack([column + 0.5 * row, row], axis=1)  # rhombs: the triangles are alike up to half a turn
    centre, beside = vertices[faces].mean(axis=1), faces_beside(faces)
    inside = np.asarray(beside.sum(axis=1) == 3)
    values = np.stack([np.full(len(faces), 0.4), centre @ [2.0, -3.0] + 1], axis=1)
    filled = harmonic_faces(np.where(inside[:, None], np.nan, values), ~inside, beside)
    assert inside.sum() > 50
    np.testing.assert_allclose(filled, values, atol=1e-6)
