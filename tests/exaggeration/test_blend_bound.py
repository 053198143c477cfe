"""Error of the linear blend and its upper bounds, against theorems."""

import numpy as np
import pytest
import trimesh
from shared_data import DATA, needs_data
from surfaces import PLAIN, RAW, bumpy, cap, sphere, torus

from carigs.exaggeration import Exaggerator
from carigs.exaggeration.blend_bound import BlendBound, blend_bounds, poincare_constant
from carigs.mesh.cotan_laplacian import CotanLaplacian, mixed_voronoi_areas
from carigs.mesh.triangle_mesh import diagonal
from carigs.settings import Exaggerate

LEVELS = np.linspace(0, 0.25, 6)


def constant(vertices: np.ndarray, faces: np.ndarray, num_components: int = 1) -> float:
    return poincare_constant(
        CotanLaplacian(vertices, faces).stiffness(), mixed_voronoi_areas(vertices, faces), num_components
    )


@pytest.mark.parametrize("radius", [0.01, 30.0])
def test_poincare_constant_of_a_sphere(radius):
    """The first eigenvalue of a sphere is 2 / R^2, so C_P = R / sqrt(2)."""
    assert constant(*sphere(2, radius)) == pytest.approx(radius / np.sqrt(2), rel=1e-5)


def test_poincare_constant_of_a_rectangle_and_of_two():
    """A flat 2 x 1 rectangle with free boundary has lambda_1 = (pi / 2)^2; of two components the larger one counts."""
    x, y = (a.ravel() for a in np.meshgrid(np.linspace(0, 2, 41), np.linspace(0, 1, 21)))
    i, j = (a.ravel() for a in np.meshgrid(np.arange(40), np.arange(20)))
    corner = i + 41 * j
    faces = np.concatenate([corner + np.array([[0], [1], [42]]), corner + np.array([[0], [42], [41]])], axis=1).T
    vertices = np.stack([x, y, 0 * x], axis=1)
    assert constant(vertices, faces) == pytest.approx(2 / np.pi, rel=1e-3)
    both = np.vstack([vertices, 0.5 * vertices + 9]), np.vstack([faces, faces + len(vertices)])
    assert constant(*both, num_components=2) == pytest.approx(2 / np.pi, rel=1e-3)


def check_order(bounds: list[BlendBound]) -> None:
    """Error <= weighted bound <= uniform bound <= the paper's bound; all are 0 at both ends and none in between."""
    for b in (bounds[0], bounds[-1]):
        np.testing.assert_allclose([b.energy, b.distance, b.distance_bound, b.distance_paper], 0, atol=1e-7)
    for b in bounds[1:-1]:
        assert 0 < b.energy <= b.energy_bound * (1 + 1e-9)
        assert 0 < b.distance <= b.distance_bound * (1 + 1e-9)
        assert b.distance_bound <= b.distance_uniform <= b.distance_paper


@pytest.mark.parametrize("options", [PLAIN, RAW])
@pytest.mark.parametrize("mesh", [bumpy(2), torus(), cap(3)])
def test_the_error_lies_below_every_bound(options, mesh):
    check_order(blend_bounds(Exaggerator(*mesh, options), 0.25, LEVELS))


def test_the_bound_holds_with_rigid_components_and_several_solved_ones():
    vertices, faces = bumpy(2)
    second, more = sphere(1, 0.2)
    both = np.vstack([vertices, second]), np.vstack([faces, more + len(vertices)])
    for rigid in (True, False):
        options = Exaggerate(limit_cavities=False, rigid_components=rigid)
        check_order(blend_bounds(Exaggerator(*both, options), 0.25, LEVELS))


def test_distances_scale_with_the_mesh_and_strains_do_not():
    vertices, faces = bumpy(2)
    one, many = (blend_bounds(Exaggerator(s * vertices, faces, PLAIN), 0.25, [0.1])[0] for s in (1.0, 1000.0))
    assert many.energy == pytest.approx(one.energy)
    for name in ("distance", "distance_bound", "distance_uniform", "distance_paper"):
        assert getattr(many, name) == pytest.approx(1000 * getattr(one, name))


@needs_data
def test_on_a_real_head_the_sharp_bound_is_tight():
    """The energy bound is within a third of the error; the paper's form exceeds it by orders of magnitude."""
    mesh = trimesh.load(DATA / "meshes/makehuman_head_eyes_female.obj", process=False, maintain_order=True)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    bounds = blend_bounds(Exaggerator(vertices, faces), 0.25, LEVELS)
    check_order(bounds)
    middle = bounds[len(bounds) // 2]
    assert middle.energy_bound < 4 / 3 * middle.energy
    assert middle.distance_paper > 100 * middle.distance
    assert middle.distance < 0.01 * diagonal(vertices)
