"""Faces that cut others, against CGAL's exact predicates."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from igl.copyleft.cgal import remesh_self_intersections
from surfaces import bumpy, cap, sphere, torus

from carigs.mesh.self_intersection import self_intersecting_faces
from carigs.mesh.triangle_mesh import components


def exact(vertices, faces):
    """CGAL's answer, without pairs of faces of different parts."""
    pairs = remesh_self_intersections(vertices, faces.astype(np.int64), detect_only=True)[2]
    part = components(faces, len(vertices))[faces[:, 0]]
    found = np.zeros(len(faces), bool)
    found[pairs[part[pairs[:, 0]] == part[pairs[:, 1]]].ravel()] = True
    return found


@pytest.mark.parametrize("surface", [sphere(3), cap(3), torus(), bumpy()], ids=["sphere", "cap", "torus", "bumpy"])
def test_an_embedded_surface_does_not_cut_itself(surface):
    assert not self_intersecting_faces(*surface).any()


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e4])
def test_a_pulled_vertex_cuts_the_other_side_and_parts_do_not_count(unit):
    vertices, faces = sphere(3, unit)
    moved = vertices.copy()
    moved[0] *= -1.7
    found = self_intersecting_faces(moved, faces)
    np.testing.assert_array_equal(found, exact(moved, faces))
    assert 0 < found.sum() < len(faces) / 2
    two = (
        np.concatenate([vertices, vertices + np.array([0.5 * unit, 0, 0])]),
        np.concatenate([faces, faces + len(vertices)]),
    )
    assert not self_intersecting_faces(*two).any()


@settings(max_examples=40, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), noise=st.floats(0.02, 0.6), shift=st.floats(-50, 50))
def test_crumpled_surfaces_agree_with_exact_predicates(seed, noise, shift):
    """Where an edge passes through three faces or more, those in the middle may be missed."""
    vertices, faces = sphere(2)
    crumpled = vertices + noise * np.random.default_rng(seed).normal(size=vertices.shape) + shift
    found, expected = self_intersecting_faces(crumpled, faces), exact(crumpled, faces)
    assert not (found & ~expected).any()
    assert found.sum() >= 0.97 * expected.sum()
