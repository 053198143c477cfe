"""The cotan Laplacian and the mixed Voronoi areas against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from surfaces import cap, sphere, torus

from carigs.mesh.cotan_laplacian import CotanLaplacian, mixed_voronoi_areas
from carigs.mesh.triangle_mesh import face_areas


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 2**31))
def test_stiffness_is_the_dirichlet_energy(seed):
    """Zero on constants, symmetric, and exact for linear functions: the energy of x.a is area times |a projected|^2."""
    random = np.random.default_rng(seed)
    vertices, faces = sphere(2)
    vertices = vertices + 0.05 * random.normal(size=vertices.shape)
    weights = random.random(len(faces)) + 0.1
    stiffness = CotanLaplacian(vertices, faces).stiffness(weights)
    np.testing.assert_allclose(stiffness @ np.ones(len(vertices)), 0, atol=1e-12)
    assert abs(stiffness - stiffness.T).max() < 1e-12
    direction = random.normal(size=3)
    a, b, c = vertices[faces.T]
    normal = np.cross(b - a, c - a)
    area = np.linalg.norm(normal, axis=1) / 2
    along = normal @ direction / (2 * area)
    energy = (weights * area * (direction @ direction - along**2)).sum()
    x = vertices @ direction
    assert x @ (stiffness @ x) == pytest.approx(energy, rel=1e-10)


def test_weighted_divergence_is_the_stiffness_applied():
    vertices, faces = cap(2)
    weights = np.random.default_rng(0).random(len(faces))
    cotans = CotanLaplacian(vertices, faces)
    np.testing.assert_allclose(
        cotans.weighted_divergence(vertices, weights), cotans.stiffness(weights) @ vertices, atol=1e-13
    )


@pytest.mark.parametrize("mesh", [sphere(2), cap(3), torus()])
def test_cells_tile_the_surface(mesh):
    areas = mixed_voronoi_areas(*mesh)
    assert (areas > 0).all()
    assert areas.sum() == pytest.approx(face_areas(*mesh).sum(), rel=1e-12)
