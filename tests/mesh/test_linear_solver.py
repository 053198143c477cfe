"""Linear solvers: both libraries, conjugate gradients, and the Poisson equation with its null space."""

import numpy as np
import pytest
from scipy.sparse import diags_array
from surfaces import bumpy

from carigs.mesh import linear_solver
from carigs.mesh.cotan_laplacian import CotanLaplacian, mixed_voronoi_areas
from carigs.mesh.linear_solver import CholeskySolver, PoissonSolver, conjugate_gradients


@pytest.fixture(params=["scipy", "cholespy"])
def library(request, monkeypatch):
    if request.param == "scipy":
        monkeypatch.setattr(linear_solver, "CholeskySolverD", None)
    elif linear_solver.CholeskySolverD is None:
        pytest.skip("cholespy is not installed (the extra `fast`)")


@pytest.mark.parametrize("columns", [1, 3, 10])
def test_cholesky_solves(library, columns):
    vertices, faces = bumpy(2)
    matrix = (CotanLaplacian(vertices, faces).stiffness() + diags_array(mixed_voronoi_areas(vertices, faces))).tocsc()
    right = np.random.default_rng(0).normal(size=(len(vertices), columns))
    np.testing.assert_allclose(matrix @ CholeskySolver(matrix).solve(right), right, atol=1e-11)


def test_conjugate_gradients_solve_or_return_none():
    vertices, faces = bumpy(2)
    matrix = (CotanLaplacian(vertices, faces).stiffness() + diags_array(mixed_voronoi_areas(vertices, faces))).tocsc()
    right = np.random.default_rng(0).normal(size=len(vertices))
    found = conjugate_gradients(matrix, right, 0 * right)
    np.testing.assert_allclose(found, CholeskySolver(matrix).solve(right[:, None])[:, 0], atol=1e-10)
    assert conjugate_gradients(matrix, right, 0 * right, most=3) is None


def test_the_poisson_solver_keeps_the_centroids():
    """The residual is 0 on the solved components, their area-weighted means are 0, and the others stay at 0."""
    vertices, faces = bumpy(2)
    v = len(vertices)
    stiffness = CotanLaplacian(np.vstack([vertices] * 3), np.vstack([faces, faces + v, faces + 2 * v])).stiffness()
    components, areas = np.repeat([0, 1, 2], v), np.tile(mixed_voronoi_areas(vertices, faces), 3)
    right = stiffness @ np.random.default_rng(0).normal(size=(3 * v, 2))
    solved = components < 2
    solution = PoissonSolver(stiffness, components, solved, areas).solve(right)
    np.testing.assert_allclose((stiffness @ solution)[solved], right[solved], atol=1e-11)
    for c in (0, 1):
        np.testing.assert_allclose((areas[:, None] * solution)[components == c].sum(axis=0), 0, atol=1e-11)
    assert not solution[~solved].any()
