"""Exaggeration gain: displacements with a known factor, anchors on a mesh."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from miniature import ball_model, sheet

from evaluation.metrics.exaggeration_gain import NEAR, exaggeration_gain, find_anchors


def displacements(seed=0, n=50):
    random = np.random.default_rng(seed)
    return random.normal(size=(n, 3)), random.uniform(0.1, 1, n)


@given(st.floats(-2, 2), st.integers(0, 20))
def test_the_gain_of_a_scaled_displacement_is_its_factor(factor, seed):
    intended, weights = displacements(seed)
    assert exaggeration_gain(factor * intended, intended, weights) == pytest.approx(factor, abs=1e-12)


def test_an_avatar_at_rest_has_gain_zero_and_half_the_way_one_half():
    intended, weights = displacements()
    assert exaggeration_gain(np.zeros_like(intended), intended, weights) == 0
    assert exaggeration_gain(intended / 2, intended, weights) == pytest.approx(0.5)


def test_motion_across_the_intended_direction_does_not_count():
    intended, weights = displacements()
    across = np.cross(intended, [0.3, -0.2, 0.9])
    assert exaggeration_gain(intended + 3 * across, intended, weights) == pytest.approx(1)


def test_the_gain_is_invariant_to_rotation():
    intended, weights = displacements()
    measured, _ = displacements(1)
    rotation = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    expected = exaggeration_gain(measured, intended, weights)
    assert exaggeration_gain(measured @ rotation, intended @ rotation, weights) == pytest.approx(expected)


def test_without_an_intended_displacement_there_is_no_gain():
    measured, weights = displacements()
    assert np.isnan(exaggeration_gain(measured, np.zeros_like(measured), weights))


def test_anchors_interpolate_linear_displacements_exactly():
    vertices, faces = sheet()
    random = np.random.default_rng(0)
    points = np.column_stack([random.uniform(-0.2, 0.2, 80), random.uniform(-0.15, 0.15, 80), np.zeros(80)])
    off = random.uniform(-0.9, 0.9, 80) * NEAR
    linear = random.normal(size=(3, 3))
    anchors = find_anchors(points + off[:, None] * [0, 0, 1], vertices, faces)
    np.testing.assert_array_equal(anchors.surfels, np.arange(80))
    np.testing.assert_allclose(anchors.displacements(vertices @ linear), points @ linear, atol=1e-12)


def test_surfels_far_from_the_mesh_have_no_anchor():
    vertices, faces = sheet()
    anchors = find_anchors(np.array([[0, 0, 0.5 * NEAR], [0, 0, 2 * NEAR], [0.2 + 2 * NEAR, 0, 0]]), vertices, faces)
    assert anchors.surfels.tolist() == [0]


def test_points_that_move_with_a_growing_ball_have_gain_one():
    model = ball_model()
    vertices, faces = model.v_template.astype(np.float64), model.faces
    random = np.random.default_rng(0)
    face, weights = random.integers(0, len(faces), 300), random.dirichlet(np.ones(3), 300)
    on_mesh = np.einsum("nc,nck->nk", weights, vertices[faces[face]])
    anchors, growth = find_anchors(on_mesh, vertices, faces), 0.2 * vertices
    moved = 1.2 * on_mesh
    assert exaggeration_gain(moved - on_mesh, anchors.displacements(growth), np.ones(300)) == pytest.approx(1, abs=1e-6)
