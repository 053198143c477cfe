"""Repair of input meshes, and the map of results back to the vertices of the input."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from carigs.errors import MeshError
from carigs.exaggeration import Exaggerator
from carigs.mesh import check_mesh, clean_mesh
from carigs.mesh.triangle_mesh import signed_volume
from carigs.settings import Exaggerate

seeds = st.integers(0, 2**32 - 1)


def bowl():
    """Part of a sphere with bumps: one boundary."""
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
    vertices, faces = np.asarray(mesh.vertices), np.asarray(mesh.faces)
    vertices = vertices * (1 + 0.1 * np.sin(5 * vertices[:, :1]))
    faces = faces[(vertices[faces].mean(axis=1)[:, 2] < 0.6)]
    used, corner = np.unique(faces, return_inverse=True)
    return vertices[used], corner.reshape(-1, 3)


VERTICES, FACES = bowl()


def unseamed(vertices, faces, cut):
    """The faces in `cut` get vertices of their own, as in a file with a texture's seam."""
    twin = np.arange(len(vertices)) + len(vertices)
    return np.concatenate([vertices, vertices]), np.where(cut[:, None], twin[faces], faces)


def damaged(random):
    """The same surface with a seam, reversed and duplicate faces, unused vertices, and another numbering."""
    vertices, faces = unseamed(VERTICES, FACES, VERTICES[FACES].mean(axis=1) @ random.normal(size=3) > 0)
    faces = np.roll(faces, random.integers(3), axis=1)
    turned = random.random(len(faces)) < 1 / 7
    faces[turned] = faces[turned][:, ::-1]
    i, j, k = faces[random.integers(len(faces))]
    vertices = np.concatenate([vertices, [[np.nan, 0, 0]], random.normal(size=(3, 3))])  # unused
    faces = np.concatenate([faces, faces[random.integers(len(faces), size=4)], [[i, i, j], [j, k, j]]])
    order = random.permutation(len(vertices))
    place = np.argsort(order)
    return vertices[order], place[faces][random.permutation(len(faces))], place[: len(VERTICES)]


def solved(vertices, faces):
    return Exaggerator(vertices, faces, Exaggerate(limit_cavities=False)).solve(0.25)


@settings(max_examples=15)
@given(seeds)
def test_repaired_damage_does_not_change_the_result(seed):
    vertices, faces, original = damaged(np.random.default_rng(seed))
    clean = clean_mesh(vertices, faces)
    check_mesh(clean.vertices, clean.faces)
    assert clean.vertices.shape == VERTICES.shape
    assert clean.faces.shape == FACES.shape
    moved = clean.to_input(solved(clean.vertices, clean.faces))
    used = np.zeros(len(vertices), bool)
    used[faces] = True
    expected = solved(VERTICES, FACES)
    seen = used[original]
    np.testing.assert_allclose(moved[original[seen]], expected[seen], atol=1e-9)
    assert not moved[~used].any()
    assert (moved[used] != 0).any(axis=1).all()


@settings(max_examples=15)
@given(seeds)
def test_the_report_counts_the_repairs(seed):
    random = np.random.default_rng(seed)
    vertices, faces, _ = damaged(random)
    report = clean_mesh(vertices, faces).report
    assert report.faces == len(faces)
    assert report.duplicate_faces == 4
    assert report.repeated_corners == 2
    assert report.components == 1
    assert report.boundary_loops == 1
    assert report.turned_faces > 0
    assert report.vertices - report.unused_vertices - report.welded_vertices == len(VERTICES)
    assert str(report.vertices) in str(report) and "turned faces" in str(report)


def test_a_valid_mesh_does_not_change():
    clean = clean_mesh(VERTICES, FACES)
    np.testing.assert_array_equal(clean.vertices, VERTICES)
    np.testing.assert_array_equal(clean.faces, FACES)
    np.testing.assert_array_equal(clean.vertex_map, np.arange(len(VERTICES)))
    np.testing.assert_array_equal(clean.to_input(VERTICES), VERTICES)


def test_closed_surfaces_face_outwards_and_those_that_touch_stay_apart():
    box = trimesh.creation.box()
    vertices = np.concatenate([box.vertices, box.vertices + np.array([1.0, 0, 0])])  # they share a side
    faces = np.concatenate([box.faces, box.faces[:, ::-1] + len(box.vertices)])
    clean = clean_mesh(vertices, faces)
    assert clean.report.components == 2
    assert clean.report.turned_faces == len(box.faces)
    for part in (clean.faces[: len(box.faces)], clean.faces[len(box.faces) :]):
        assert signed_volume(clean.vertices, part) == pytest.approx(1.0)


def test_a_sheet_is_oriented_as_most_of_its_area_was():
    x, y = np.meshgrid(np.arange(6.0), np.arange(6.0))
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(36)], axis=1)
    corner = np.arange(36).reshape(6, 6)
    a, b, c, d = corner[:-1, :-1].ravel(), corner[:-1, 1:].ravel(), corner[1:, 1:].ravel(), corner[1:, :-1].ravel()
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)])
    broken = faces.copy()
    broken[[3, 11, 17]] = broken[[3, 11, 17]][:, ::-1]
    clean = clean_mesh(vertices, broken)
    assert clean.report.turned_faces == 3
    p, q, r = vertices[clean.faces.T]
    assert (np.cross(q - p, r - p)[:, 2] > 0).all()


@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_units_do_not_matter(scale):
    vertices, faces, _ = damaged(np.random.default_rng(5))
    assert clean_mesh(scale * vertices, faces).report == clean_mesh(vertices, faces).report


def test_slivers_without_area_are_left_out():
    middle = VERTICES[FACES[7]][:2].mean(axis=0)
    faces = np.concatenate([FACES, [[FACES[7, 0], FACES[7, 1], len(VERTICES)]]])
    report = clean_mesh(np.concatenate([VERTICES, [middle]]), faces).report
    assert (report.without_area, report.unused_vertices) == (1, 1)


FIN = np.concatenate([VERTICES, [[0, 0, 3.0]]]), np.concatenate([FACES, [[FACES[40, 0], FACES[40, 1], len(VERTICES)]]])


@pytest.mark.parametrize(
    ("vertices", "faces", "words"),
    [
        (np.zeros((0, 3)), np.zeros((0, 3), int), "expected"),
        (VERTICES[:, :2], FACES, "expected"),
        (VERTICES, FACES.astype(float), "vertex numbers"),
        (VERTICES, np.where(FACES == 9, 10**6, FACES), "corner that is no vertex"),
        (np.where(np.arange(len(VERTICES))[:, None] == 9, np.inf, VERTICES), FACES, "vertex 9 is not finite"),
        (np.zeros((3, 3)), np.array([[0, 1, 2]]), "none of the 1 faces has an area"),
        (np.eye(3), np.array([[0, 0, 2]]), "none of the 1 faces has an area"),
        (*FIN, f"edge {min(FACES[40, :2])}-{max(FACES[40, :2])} belongs to 3 faces"),
    ],
)
def test_meshes_that_cannot_be_repaired_are_named(vertices, faces, words):
    with pytest.raises(MeshError, match=words):
        clean_mesh(vertices, faces)


@pytest.mark.parametrize("distance", [1e4, 1e9, 1e20])
def test_a_stray_vertex_is_refused_and_not_taken_as_the_size_of_the_mesh(distance):
    """Faces of the rest would be removed as too small, or their corners welded."""
    vertices, faces = VERTICES.copy(), FACES
    vertices[17] = [distance, 0, 0]
    with pytest.raises(MeshError, match=r"vertex 17 is .* times as far"):
        clean_mesh(vertices, faces)
    vertices[17] = [40, 0, 0]  # far, but what a body below the head could be
    assert clean_mesh(vertices, faces).report.without_area == 0
