"""Gaps between borders that are not joined: found with their width, and named when a deformation opens them."""

import warnings

import numpy as np
import pytest
import trimesh

import carigs
from carigs.errors import CarigsWarning
from carigs.mesh.gaps import find_gaps, warn_of_opened_gaps
from tests.mesh.test_welding import FACES, VERTICES, grid, mouth


def two_sheets(gap, edges=5):
    """Two sheets side by side; the border of 12 edges lies along one of fewer, whose vertices are elsewhere."""
    left, left_faces = grid(4, 12)
    right, right_faces = grid(4, edges)
    right = right * [1, 12 / edges, 0] + [4 + gap, 0, 0]
    return np.concatenate([left, right]), np.concatenate([left_faces, right_faces + len(left)]), len(left)


@pytest.mark.parametrize("edges", [2, 5, 11])
@pytest.mark.parametrize("gap", [0.0, 1e-6, 0.05])
def test_the_width_of_a_gap_is_the_distance_of_the_borders(gap, edges):
    vertices, faces, n = two_sheets(gap, edges)
    gaps = find_gaps(vertices, faces)
    np.testing.assert_allclose(gaps.widths(vertices), gap, atol=1e-12)
    sides = np.flatnonzero(np.isclose(vertices[:, 0], 4) & (np.arange(len(vertices)) < n))
    assert set(sides) <= set(gaps.vertex)  # each vertex of the finer border lies on an edge of the coarser
    moved = vertices + (np.arange(len(vertices)) >= n)[:, None] * np.array([0.5, 0, 0])
    np.testing.assert_allclose(gaps.widths(moved), gap + 0.5, atol=1e-12)


def test_honest_borders_have_no_gaps():
    assert len(find_gaps(VERTICES, FACES).vertex) == 0
    closed = trimesh.creation.icosphere()
    assert len(find_gaps(np.asarray(closed.vertices), np.asarray(closed.faces)).vertex) == 0
    vertices, faces = mouth(2.0)  # open: only beside its corners the lips are near each other
    assert len(find_gaps(vertices, faces).vertex) == 0


def test_a_gap_that_opens_is_named_with_its_size_before_and_after():
    vertices, faces, n = two_sheets(1e-6)
    moved = vertices + (np.arange(len(vertices)) >= n)[:, None] * np.array([0.25, 0, 0])
    with pytest.warns(CarigsWarning, match=r"level 0\.2: .* by up to 1e-06 before and 0\.25 after") as raised:
        warn_of_opened_gaps(vertices, moved, faces, "level 0.2")
    assert "\n" not in str(raised[0].message)


def test_a_gap_that_moves_or_grows_with_its_parts_is_no_matter():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        for vertices, faces in (two_sheets(1e-6)[:2], mouth(0.02)):
            warn_of_opened_gaps(vertices, 1.2 * vertices[:, [1, 2, 0]] + 7, faces, "level 1")


def barrel(columns, bottom, top):
    """A part of an ellipsoid between two heights, as a quadrilateral mesh around its axis."""
    vertices, faces = grid(columns, 12)
    angle, height = 2 * np.pi * vertices[:, 0] / columns, bottom + (top - bottom) * vertices[:, 1] / 12
    radius = np.sqrt(1 - height**2) * (1 + 0.1 * np.cos(3 * angle) * (1 + height))
    return np.stack([0.8 * radius * np.cos(angle), height, 0.6 * radius * np.sin(angle)], axis=1), faces


def test_the_caricature_of_parts_that_are_not_joined_says_so():
    """The border of 48 edges lies along one of 96, 57 nm apart on a body of 2 m: every second vertex is welded."""
    (lower, lower_faces), (upper, upper_faces) = barrel(48, -0.9, 0.1), barrel(96, 0.1 + 5.7e-8, 0.95)
    vertices = np.concatenate([lower, upper])
    faces = np.concatenate([lower_faces, upper_faces + len(lower)])
    with pytest.warns(CarigsWarning, match=r"level 0\.25: borders of parts that are not joined gape at \d+ vertices"):
        carigs.exaggerate(vertices, faces, 0.25, limit_cavities=False)
