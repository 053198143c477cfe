"""The air between surfaces by closed forms; occlusion on disk; factors by either library."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import diags_array
from scipy.spatial.transform import Rotation
from surfaces import bumpy, sphere

from carigs.exaggeration.gap_stiffness import NARROW, REACH, gap_stiffness
from carigs.mesh import ambient_occlusion as occlusion
from carigs.mesh import linear_solver as factors
from carigs.mesh.cotan_laplacian import CotanLaplacian, mixed_voronoi_areas
from carigs.mesh.linear_solver import CholeskySolver, conjugate_gradients
from carigs.mesh.triangle_mesh import size


def plates(gap: float, n: int = 12) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Two unit squares that face each other at a distance; which vertices are on the upper one."""
    x, y = (a.ravel() for a in np.meshgrid(*[np.linspace(0, 1, n + 1)] * 2))
    i, j = (a.ravel() for a in np.meshgrid(np.arange(n), np.arange(n)))
    corner = i + (n + 1) * j
    lower = np.concatenate(
        [corner + np.array([[0], [1], [n + 2]]), corner + np.array([[0], [n + 2], [n + 1]])], axis=1
    ).T
    square = np.stack([x, y, 0 * x], axis=1)
    vertices = np.concatenate([square, square + np.array([0, 0, gap])])
    return vertices, np.concatenate([lower, lower[:, ::-1] + len(square)]), vertices[:, 2] > gap / 2


@pytest.mark.parametrize("gap", [1e-4, 5e-3, 0.03])
def test_air_between_plates_is_an_elastic_column(gap):
    """Lifting one of them costs |u|^2 / t^2 on both unit areas, faded at the reach and bounded where it is narrow."""
    vertices, faces, upper = plates(gap)
    stiffness, extent = gap_stiffness(vertices, faces), size(vertices, faces)
    narrow, reach = (NARROW * extent) ** 2, (REACH * extent) ** 2
    expected = 2 * (1 / (gap**2 + narrow) - 1 / (reach + narrow)) if gap < REACH * extent else 0.0
    lift = upper.astype(float)
    assert lift @ (stiffness @ lift) == pytest.approx(expected, rel=1e-6)
    np.testing.assert_allclose(stiffness @ np.ones(len(lift)), 0, atol=1e-9 * max(expected, 1))
    assert abs(stiffness - stiffness.T).max() <= 1e-12 * max(expected, 1)


def test_back_to_back_there_is_no_air():
    vertices, faces, _ = plates(5e-3)
    assert gap_stiffness(vertices, faces[:, ::-1]).nnz == 0


@given(st.floats(-6, 6), st.tuples(*[st.floats(-3, 3)] * 3))
def test_air_has_no_unit_and_turns_with_the_mesh(exponent, rotation_vector):
    vertices, faces, _ = plates(5e-3, n=4)
    turned = 10.0**exponent * vertices @ Rotation.from_rotvec(rotation_vector).as_matrix().T
    expected, found = gap_stiffness(vertices, faces).toarray(), gap_stiffness(turned, faces).toarray()
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


def test_turned_meshes_see_the_same():
    vertices, faces = bumpy()
    vertices = vertices @ np.array([[1, 0.1, 0.2], [0, 1, 0.1], [0, 0, 1]])  # where two mirrors meet, no side is first
    turn = Rotation.from_rotvec([0.3, 1.0, -2.0]).as_matrix()
    expected = occlusion.ambient_occlusion(vertices, faces)
    np.testing.assert_allclose(occlusion.ambient_occlusion(vertices @ turn.T + 100, faces), expected, atol=1e-12)


@pytest.mark.parametrize("damage", [None, b"", b"nothing", "shape", "nan"])
def test_occlusion_is_kept_and_a_broken_entry_is_made_again(damage, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    vertices, faces = bumpy(2)
    every = np.ones(len(vertices), bool)
    expected = occlusion.cached_occlusion(vertices, faces, every)
    np.testing.assert_array_equal(expected, occlusion.ambient_occlusion(vertices, faces))
    (entry,) = (tmp_path / "carigs/occlusion").iterdir()
    if isinstance(damage, bytes):
        entry.write_bytes(damage)
    elif damage:
        np.save(entry, expected[1:] if damage == "shape" else expected * np.nan)
    else:
        monkeypatch.setattr(occlusion, "ambient_occlusion", None)  # must not be called
    np.testing.assert_array_equal(occlusion.cached_occlusion(vertices, faces, every), expected)


def test_another_mesh_has_another_entry_and_a_cache_that_cannot_be_written_is_done_without(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    vertices, faces = sphere(1)
    every = np.ones(len(vertices), bool)
    for mesh in (vertices, 1.5 * vertices):
        occlusion.cached_occlusion(mesh, faces, every)
    assert len(list((tmp_path / "carigs/occlusion").iterdir())) == 2
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    occlusion.cached_occlusion(vertices, faces, every)


@pytest.fixture(params=["scipy", "cholespy"])
def library(request, monkeypatch):
    if request.param == "scipy":
        monkeypatch.setattr(factors, "CholeskySolverD", None)
    elif factors.CholeskySolverD is None:
        pytest.skip("cholespy is not installed (the extra `fast`)")


@pytest.mark.parametrize("columns", [1, 3, 10])
def test_factors_solve(library, columns):
    vertices, faces = bumpy(2)
    matrix = (CotanLaplacian(vertices, faces).stiffness() + diags_array(mixed_voronoi_areas(vertices, faces))).tocsc()
    right = np.random.default_rng(0).normal(size=(len(vertices), columns))
    np.testing.assert_allclose(matrix @ CholeskySolver(matrix).solve(right), right, atol=1e-11)


def test_conjugate_gradients_solve_or_say_that_they_do_not():
    vertices, faces = bumpy(2)
    matrix = (CotanLaplacian(vertices, faces).stiffness() + diags_array(mixed_voronoi_areas(vertices, faces))).tocsc()
    right = np.random.default_rng(0).normal(size=len(vertices))
    found = conjugate_gradients(matrix, right, 0 * right)
    np.testing.assert_allclose(found, CholeskySolver(matrix).solve(right[:, None])[:, 0], atol=1e-10)
    assert conjugate_gradients(matrix, right, 0 * right, most=3) is None
