"""The exaggeration against theorems: spheres, invariances, a manufactured solution; and on real heads."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shared_data import DATA, needs_data
from surfaces import PLAIN, RAW, bumpy, cap, sphere, torus

from carigs.errors import MeshError, SettingsError
from carigs.exaggeration import Exaggerator, straight_path
from carigs.mesh.cotan_laplacian import CotanLaplacian
from carigs.mesh.triangle_mesh import boundary_vertices, diagonal
from carigs.settings import Exaggerate


@pytest.mark.parametrize("radius", [0.5, 3.0])
def test_sphere_law(radius):
    """|K| = R^-2 everywhere, so S_gamma = R^(-2 gamma) S, at second order in the edge length."""
    errors = []
    for subdivisions in (1, 2, 3, 4, 5):  # four refinements
        vertices, faces = sphere(subdivisions, radius)
        moved = vertices + Exaggerator(vertices, faces, RAW).solve(0.25)
        errors.append(np.abs(moved - radius**-0.5 * vertices).max() / radius)
    assert errors[-1] < 1e-3
    assert (np.log2(np.divide(errors[:-1], errors[1:])) > 1.8).all()


def test_manufactured_solution_on_a_cap():
    """On the unit sphere, div((1 + z/2) grad z) = Lap(z^2/4 + z); with that boundary, z^2/4 + z is the solution."""
    from scipy.sparse.linalg import spsolve

    errors = []
    for subdivisions in (2, 3, 4, 5, 6):  # four refinements
        vertices, faces = cap(subdivisions)
        laplacian, z = CotanLaplacian(vertices, faces), vertices[:, 2]
        weights = 1 + z[faces].mean(axis=1) / 2
        right = laplacian.weighted_divergence(vertices, weights)[:, 2]
        exact, rim = z**2 / 4 + z, boundary_vertices(faces, len(vertices))
        stiffness = laplacian.stiffness().tocsr()
        solved = exact.copy()
        right = right - stiffness[:, rim] @ exact[rim]
        solved[~rim] = spsolve(stiffness[~rim][:, ~rim].tocsc(), right[~rim])
        errors.append(np.sqrt(np.mean((solved - exact) ** 2)))
    assert (np.log2(np.divide(errors[:-1], errors[1:])) > 1.8).all()


@pytest.mark.parametrize("options", [RAW, PLAIN, Exaggerate()])
def test_level_zero_is_the_input_bit_for_bit(options):
    vertices, faces = bumpy(2)
    solver = Exaggerator(vertices, faces, options)
    assert not solver.solve(0.0).any()
    assert not solver.path(0.25).displacement(0.0).any()


@settings(max_examples=12, deadline=None)
@given(st.floats(-6, 6), st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(*[st.floats(-100, 100)] * 3))
def test_unit_rotation_and_translation_do_not_matter(exponent, rotation_vector, shift):
    vertices, faces = bumpy(2)
    rotation, scale = Rotation.from_rotvec(rotation_vector).as_matrix(), 10.0**exponent
    moved = scale * (vertices @ rotation.T + np.array(shift))
    expected = scale * Exaggerator(vertices, faces, PLAIN).solve(0.25) @ rotation.T
    np.testing.assert_allclose(Exaggerator(moved, faces, PLAIN).solve(0.25), expected, atol=1e-9 * scale * 1.5)


def test_numbering_does_not_matter():
    vertices, faces = bumpy(2)
    random = np.random.default_rng(0)
    order = random.permutation(len(vertices))
    renumbered = np.argsort(order)[faces][random.permutation(len(faces))]
    expected = Exaggerator(vertices, faces, PLAIN).solve(0.25)[order]
    np.testing.assert_allclose(Exaggerator(vertices[order], renumbered, PLAIN).solve(0.25), expected, atol=1e-10)


def test_each_component_keeps_its_centroid():
    vertices, faces = bumpy(2)
    second, more = torus()
    both, all_faces = np.vstack([vertices, second + np.array([4, 0, 0])]), np.vstack([faces, more + len(vertices)])
    solver = Exaggerator(both, all_faces, Exaggerate(limit_cavities=False, rigid_components=False))
    displacement = solver.solve(0.3)
    for c in (0, 1):
        inside = solver.component_labels == c
        mean = np.average(displacement[inside], axis=0, weights=solver.areas[inside])
        np.testing.assert_allclose(mean, 0, atol=1e-12)
        assert np.abs(displacement[inside]).max() > 1e-3


def test_cavities_are_limited_and_convex_parts_are_not():
    """A sphere with a deep dent: only the dent's weights change."""
    vertices, faces = sphere(4)
    dent = np.exp(-((vertices[:, 2] - 1) ** 2) / 0.02 - (vertices[:, :2] ** 2).sum(axis=1) / 0.05)
    vertices = vertices * (1 - 0.8 * dent[:, None])
    limited, free = Exaggerator(vertices, faces), Exaggerator(vertices, faces, PLAIN)
    changed = limited.log_curvature < free.log_curvature - 1e-9
    assert changed.any()
    assert dent[changed].min() > 1e-3
    np.testing.assert_allclose(limited.log_curvature[~changed], free.log_curvature[~changed])


def test_weights_have_mean_one():
    vertices, faces = bumpy()
    solver = Exaggerator(vertices, faces, PLAIN)
    assert np.average(solver.weights(0.25), weights=solver.face_areas) == pytest.approx(1)


def test_many_levels_are_the_levels_one_by_one():
    solver = Exaggerator(*bumpy(2), PLAIN)
    together = solver.solve_many([0.0, 0.1, 0.25])
    expected = np.stack([solver.solve(level) for level in (0.0, 0.1, 0.25)])
    np.testing.assert_allclose(together, expected, rtol=0, atol=1e-12)
    assert not together[0].any()


def test_the_report_counts_what_was_limited():
    vertices, faces = cap(3)
    solver = Exaggerator(vertices, faces)
    assert solver.report["boundary_vertices"] == boundary_vertices(faces, len(vertices)).sum()
    assert solver.report["limited_vertices"] == 0  # outside, a cap is convex
    low, high = solver.report["log_curvature"]
    assert (low, high) == (solver.log_curvature.min(), solver.log_curvature.max())


def test_surfaces_that_have_no_curvature_or_no_outside_are_refused():
    vertices, faces = sphere(1)
    with pytest.raises(MeshError, match="turned inwards"):
        Exaggerator(vertices, faces[:, ::-1])
    with pytest.raises(MeshError, match="every vertex lies on the boundary"):
        Exaggerator(np.eye(3), np.array([[0, 1, 2]]))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("curvature_floor", 0.0),
        ("curvature_floor", float("nan")),
        ("curvature_smoothing", -0.1),
        ("path_nodes", 1),
        ("path_nodes", -1),
        ("gap_stiffness", float("nan")),
        ("region_constraint", "hard"),
        ("curvature_source", "mean"),
    ],
)
def test_settings_out_of_range_are_named(field, value):
    with pytest.raises(SettingsError, match=rf"exaggerate\.{field}="):
        Exaggerator(*sphere(1), Exaggerate(**{field: value}))


@pytest.mark.parametrize("gamma", [0.0, float("nan"), float("inf")])
def test_a_path_needs_a_level(gamma):
    with pytest.raises(SettingsError, match=f"gamma={gamma:g}"):
        Exaggerator(*sphere(1), PLAIN).path(gamma)


@pytest.mark.parametrize("name", ["makehuman_head_eyes_female", "ict_head_id0_5042"])
@needs_data
def test_on_a_real_head(name):
    """The path is within 1e-4 of the diagonal of exact solves, the linear blend is not; no face is inverted."""
    mesh = trimesh.load(DATA / f"meshes/{name}.obj", process=False, maintain_order=True)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    solver, size = Exaggerator(vertices, faces), diagonal(np.asarray(mesh.vertices))
    path = solver.path(0.25)
    linear = straight_path(vertices, faces, solver.solve(0.25), 0.25)
    levels = np.linspace(0.02, 0.23, 6)
    exact = [solver.solve(g) for g in levels]
    error = max(np.abs(path.displacement(g) - e).max() for g, e in zip(levels, exact, strict=True)) / size
    blend = max(np.abs(linear.displacement(g) - e).max() for g, e in zip(levels, exact, strict=True)) / size
    assert error < 1e-4 < blend

    def normals(v):
        return np.cross(v[faces[:, 1]] - v[faces[:, 0]], v[faces[:, 2]] - v[faces[:, 0]])

    turned = (normals(vertices) * normals(vertices + path.displacement(0.25))).sum(axis=1) < 0
    assert not turned.any()
