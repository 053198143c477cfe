"""Operators and curvature against closed forms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from surfaces import cap, sphere, torus

from carigs.errors import MeshError
from carigs.mesh.cotan_laplacian import CotanLaplacian, mixed_voronoi_areas
from carigs.mesh.curvature import angle_defects, extrapolated, heat_smoothed
from carigs.mesh.triangle_mesh import boundary_vertices, check_mesh, components, face_areas, signed_volume


@pytest.mark.parametrize(("mesh", "euler"), [(sphere(2), 2), (cap(3), 1), (torus(), 0)])
def test_gauss_bonnet(mesh, euler):
    vertices, faces = mesh
    defects = angle_defects(vertices, faces, boundary_vertices(faces, len(vertices)))
    assert defects.sum() == pytest.approx(2 * np.pi * euler, abs=1e-10)


@pytest.mark.parametrize("radius", [0.1, 3.0])
def test_curvature_of_a_sphere_converges_at_second_order(radius):
    errors = []
    for subdivisions in (2, 3, 4):
        vertices, faces = sphere(subdivisions, radius)
        curvature = angle_defects(vertices, faces, np.zeros(len(vertices), bool)) / mixed_voronoi_areas(vertices, faces)
        errors.append(np.abs(curvature * radius**2 - 1).max())
    orders = np.log2(np.divide(errors[:-1], errors[1:]))
    assert errors[-1] < 2e-3
    assert (orders > 1.8).all()


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


def test_heat_keeps_the_integral_and_smooths():
    vertices, faces = torus()
    areas, stiffness = mixed_voronoi_areas(vertices, faces), CotanLaplacian(vertices, faces).stiffness()
    noise = np.random.default_rng(1).normal(size=len(vertices))
    smooth = heat_smoothed(noise, areas, stiffness, 0.01)
    assert areas @ smooth == pytest.approx(areas @ noise, rel=1e-9)
    assert smooth @ stiffness @ smooth < 0.1 * (noise @ stiffness @ noise)
    assert smooth @ (areas * smooth) < noise @ (areas * noise)


def test_extrapolation_fills_rings_from_inside_and_keeps_the_rest():
    vertices, faces = cap(3)
    unknown = boundary_vertices(faces, len(vertices))
    values = np.where(unknown, np.nan, 7.0)
    np.testing.assert_array_equal(extrapolated(values, faces, unknown), 7.0)
    values = np.where(unknown, np.nan, vertices[:, 2])
    filled = extrapolated(values, faces, unknown)
    np.testing.assert_array_equal(filled[~unknown], vertices[~unknown, 2])
    assert np.abs(filled - vertices[:, 2])[unknown].max() < 0.2


def test_components_and_boundary():
    vertices, faces = sphere(1)
    both = np.vstack([faces, faces + len(vertices)])
    labels = components(both, 2 * len(vertices))
    assert set(labels[: len(vertices)]) == {0}
    assert set(labels[len(vertices) :]) == {1}
    assert not boundary_vertices(both, 2 * len(vertices)).any()
    rim, faces = cap(3)
    on_rim = boundary_vertices(faces, len(rim))
    assert rim[on_rim, 2].max() < rim[~on_rim, 2].min() + 0.2
    assert on_rim.any()


def test_volume_of_a_ball_and_of_one_inside_out():
    vertices, faces = sphere(4, 2.0)
    assert signed_volume(vertices + 7, faces) == pytest.approx(4 / 3 * np.pi * 8, rel=5e-3)
    assert signed_volume(vertices, faces[:, ::-1]) == pytest.approx(-signed_volume(vertices, faces))


def damaged(name: str) -> tuple[np.ndarray, np.ndarray]:
    vertices, faces = sphere(1)
    if name == "nan":
        vertices[7] = np.nan
    elif name == "range":
        faces[5, 1] = 1000
    elif name == "repeat":
        faces[5, 1] = faces[5, 0]
    elif name == "area":
        vertices[faces[5]] = vertices[faces[5, 0]]
    elif name == "isolated":
        vertices = np.vstack([vertices, [[5.0, 5, 5]]])
    elif name == "fin":
        faces = np.vstack([faces, [[faces[0, 0], faces[0, 1], faces[40, 2]]]])
    elif name == "floats":
        faces = faces.astype(float)
    elif name == "empty":
        faces = faces[:0]
    return vertices, faces


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("nan", "vertex 7 is not finite"),
        ("range", "face 5 has a corner that is no vertex"),
        ("repeat", "face 5 repeats a corner"),
        ("area", "face .* has no area"),
        ("isolated", "vertex 42 belongs to no face"),
        ("fin", "belongs to 3 faces"),
        ("floats", "faces must be vertex numbers, found float64"),
        ("empty", "expected"),
    ],
)
def test_bad_meshes_are_named(name, says):
    with pytest.raises(MeshError, match=says):
        check_mesh(*damaged(name))
