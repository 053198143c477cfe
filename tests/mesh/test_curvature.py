"""Curvature estimates against closed forms."""

import numpy as np
import pytest
from surfaces import cap, sphere, torus

from carigs.mesh.cotan_laplacian import CotanLaplacian, mixed_voronoi_areas
from carigs.mesh.curvature import angle_defects, diffuse_heat, extrapolate, log_stabilized_curvature
from carigs.mesh.triangle_mesh import boundary_vertices


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


def test_heat_keeps_the_integral_and_smooths():
    vertices, faces = torus()
    areas, stiffness = mixed_voronoi_areas(vertices, faces), CotanLaplacian(vertices, faces).stiffness()
    noise = np.random.default_rng(1).normal(size=len(vertices))
    smooth = diffuse_heat(noise, areas, stiffness, 0.01)
    assert areas @ smooth == pytest.approx(areas @ noise, rel=1e-9)
    assert smooth @ stiffness @ smooth < 0.1 * (noise @ stiffness @ noise)
    assert smooth @ (areas * smooth) < noise @ (areas * noise)


def test_extrapolation_fills_rings_from_inside_and_keeps_the_rest():
    vertices, faces = cap(3)
    unknown = boundary_vertices(faces, len(vertices))
    values = np.where(unknown, np.nan, 7.0)
    np.testing.assert_array_equal(extrapolate(values, faces, unknown), 7.0)
    values = np.where(unknown, np.nan, vertices[:, 2])
    filled = extrapolate(values, faces, unknown)
    np.testing.assert_array_equal(filled[~unknown], vertices[~unknown, 2])
    assert np.abs(filled - vertices[:, 2])[unknown].max() < 0.2


def test_stabilised_curvature_is_the_root_of_the_squares():
    """|K|_eps = sqrt(K^2 + eps^2): eps where K is 0, sqrt(2) eps where |K| is eps; the unit only adds a constant."""
    curvature, areas, counted = np.array([0.0, 3.0, -3.0, 3.0]), np.ones(4), np.array([False, True, True, True])
    logarithm, reference = log_stabilized_curvature(curvature, areas, counted, 1.0)
    assert reference == pytest.approx(np.log(3))
    np.testing.assert_allclose(np.exp(logarithm), 3 * np.array([1, np.sqrt(2), np.sqrt(2), np.sqrt(2)]))
    np.testing.assert_allclose(
        log_stabilized_curvature(100 * curvature, areas, counted, 1.0)[0], logarithm + np.log(100), rtol=1e-12
    )


def test_the_reference_is_a_mean_over_the_area():
    """Halves of a cell with the same curvature count as the cell does: a finer mesh has the same reference."""
    curvature, areas = np.array([1.0, -np.e, 5.0]), np.array([3.0, 1.0, 7.0])
    counted = np.array([True, True, False])
    values, reference = log_stabilized_curvature(curvature, areas, counted, 0.5)
    assert reference == pytest.approx(1 / 4)
    np.testing.assert_allclose(values, np.log(np.hypot(curvature, 0.5 * np.exp(1 / 4))))
    halved = log_stabilized_curvature(curvature[[0, 0, 1, 2]], np.array([1.5, 1.5, 1, 7]), counted[[0, 0, 1, 2]], 0.5)
    np.testing.assert_allclose(halved[0], values[[0, 0, 1, 2]])
