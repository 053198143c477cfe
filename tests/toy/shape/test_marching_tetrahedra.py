"""Marching tetrahedra: closed oriented manifolds for every sign pattern, exact for linear functions."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from carigs.toy.shape.marching_tetrahedra import marching_tetrahedra


def test_every_sign_pattern_gives_a_closed_oriented_manifold() -> None:
    values = np.ones((12, 12, 12))
    values[1:-1, 1:-1, 1:-1] = np.random.default_rng(0).standard_normal((10, 10, 10))
    vertices, faces = marching_tetrahedra(values, np.zeros(3), 1.0)
    edges = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    assert len(np.unique(edges, axis=0)) == len(edges)
    # Each directed edge has its opposite: there is no boundary.
    assert {tuple(edge) for edge in edges} == {tuple(edge[::-1]) for edge in edges}
    assert len(np.unique(vertices, axis=0)) == len(vertices)


def test_a_sphere_has_its_radius_and_faces_outwards() -> None:
    low, step = np.full(3, -1.5), 0.1
    grid = low[:, None, None, None] + step * np.indices((31, 31, 31))
    vertices, faces = marching_tetrahedra(np.linalg.norm(grid, axis=0) - 1.0, low, step)
    # Linear interpolation of a distance: an error of second order.
    np.testing.assert_allclose(np.linalg.norm(vertices, axis=1), 1.0, atol=step**2 / 2)
    assert trimesh.Trimesh(vertices, faces, process=False).volume == pytest.approx(4 / 3 * np.pi, rel=0.02)


def test_linear_functions_are_reproduced_and_the_surface_is_open_at_the_grid() -> None:
    normal, low, step = np.array([0.3, -0.5, 0.8]), np.array([1.0, 2.0, 3.0]), 0.5
    points = low[:, None, None, None] + step * np.indices((6, 7, 8))
    middle = points.reshape(3, -1).mean(axis=1)
    vertices, faces = marching_tetrahedra(np.einsum("i,ijkl->jkl", normal, points) - normal @ middle, low, step)
    np.testing.assert_allclose((vertices - middle) @ normal, 0, atol=1e-12)
    a, b, c = vertices[faces.T]
    assert (np.cross(b - a, c - a) @ normal > -1e-12).all()  # towards positive values
