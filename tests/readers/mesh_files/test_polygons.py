"""Polygons become triangles that cover them: n - 2 of them, none turned, with the polygon's area."""

import time
import warnings

import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from carigs.errors import CarigsWarning, InputError
from carigs.mesh import clean_mesh
from carigs.readers.mesh_files.meshes import read_mesh, read_polygons
from carigs.readers.mesh_files.polygons import Polygons, triangulate_polygons

seeds = st.integers(0, 2**32 - 1)


def signed_areas(points, triangles):
    a, b, c = np.moveaxis(points[triangles], 1, 0)
    p, q = b - a, c - a
    return (p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]) / 2


def area(points):
    x, y = points.T
    return (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2


def star(n, random):
    """A simple polygon, counterclockwise: corners around the origin, less than half a turn from one to the next."""
    angle = 2 * np.pi * (np.arange(n) + random.uniform(-0.4, 0.4, n)) / n
    return random.uniform(0.1, 1, n)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def cut(points, order=None):
    """Triangles of one polygon."""
    order = np.arange(len(points)) if order is None else order
    return triangulate_polygons(Polygons(points, order, np.array([len(order)])), "a.obj")


@given(seeds, st.integers(4, 30))
def test_triangles_of_a_simple_polygon_cover_it(seed, n):
    random = np.random.default_rng(seed)
    flat = star(n, random)
    rotation = Rotation.random(random_state=seed % 2**31).as_matrix()
    points = np.concatenate([flat, np.zeros((n, 1))], axis=1) @ rotation.T * 10.0 ** random.integers(-3, 4)
    triangles = cut(points + random.normal(size=3))
    areas = signed_areas(flat, triangles)
    assert triangles.shape == (n - 2, 3)
    assert areas.min() > -1e-12
    np.testing.assert_allclose(areas.sum(), area(flat), rtol=1e-9)


SHAPES = {
    "arrow": [[0, 0], [2, 2], [0, 1], [-2, 2]],
    "concave pentagon": [[0, 0], [4, 0], [4, 4], [2, 1], [0, 4]],
    "corners on a side": [[0, 0], [1, 0], [2, 0], [3, 0], [3, 2], [0, 2]],
    "a corner on each side": [[0, 0], [1, 0], [2, 0], [2, 1], [2, 2], [1, 2], [0, 2], [0, 1]],
    "quadrilateral with a corner on a side": [[1, 0], [2, 0], [1, 2], [0, 0]],
    "comb": [[0, 0], [7, 0], [7, 5], [6, 5], [6, 1], [5, 1], [5, 5], [4, 5], [4, 1], [3, 1], [3, 5], [0, 5]],
    "cross": [[1, 0], [2, 0], [2, 1], [3, 1], [3, 2], [2, 2], [2, 3], [1, 3], [1, 2], [0, 2], [0, 1], [1, 1]],
}


@pytest.mark.parametrize("name", SHAPES)
@pytest.mark.parametrize("tilt", [0.0, 0.7])
def test_from_every_first_corner_no_triangle_is_turned_or_empty(name, tilt):
    flat = np.array(SHAPES[name], float)
    rotation = Rotation.from_rotvec([tilt, tilt / 2, 0]).as_matrix()
    points = np.concatenate([flat, np.zeros((len(flat), 1))], axis=1) @ rotation.T
    for first in range(len(flat)):
        triangles = cut(points, np.roll(np.arange(len(flat)), -first))
        areas = signed_areas(flat, triangles)
        assert len(triangles) == len(flat) - 2
        assert areas.min() > 1e-6
        np.testing.assert_allclose(areas.sum(), area(flat))


def test_a_repeated_corner_gives_an_empty_triangle_and_nothing_else():
    flat = np.array(SHAPES["concave pentagon"], float)
    triangles = cut(np.concatenate([flat, np.zeros((5, 1))], axis=1), np.array([0, 1, 1, 2, 3, 4]))
    areas = signed_areas(flat, triangles)
    assert sorted(areas > 0) == [False, True, True, True] and areas.min() == 0
    np.testing.assert_allclose(areas.sum(), area(flat))


def test_a_bent_quadrilateral_is_cut_alike_in_any_place_and_size():
    bent = np.array([[0, 0, 0], [1, 0, 0.3], [1, 1, 0], [0, 1, 0.3]], float)
    expected = cut(bent)
    for seed in range(5):
        rotation = Rotation.random(random_state=seed).as_matrix()
        np.testing.assert_array_equal(cut(1e-4 * bent @ rotation.T + seed), expected)


@pytest.mark.parametrize("crossing", [[[0, 0], [1, 1], [1, 0], [0, 1]], [[0, 0], [3, 3], [3, 0], [0, 2], [1, 3]]])
def test_a_polygon_that_crosses_itself_is_named(crossing):
    points = np.concatenate([crossing, np.zeros((len(crossing), 1))], axis=1)
    square = np.array([[5, 5, 0], [6, 5, 0], [6, 6, 0], [5, 6, 0]])
    corners, lengths = np.arange(len(points) + 4), np.array([4, len(points)])
    with pytest.warns(
        CarigsWarning, match=r"a\.obj: 1 polygons cross themselves or are folded \(the first is face 1, from 0\)"
    ):
        triangles = triangulate_polygons(Polygons(np.concatenate([square, points]), corners, lengths), "a.obj")
    assert len(triangles) == 2 + len(points) - 2
    assert set(triangles.ravel()) == set(range(len(points) + 4))


def test_polygons_without_area_are_no_error():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert len(cut(np.ones((5, 3)))) == 3
        assert len(cut(np.outer(np.arange(6.0), [1, 2, 3]))) == 4


def test_many_corners_are_refused_before_work():
    random = np.random.default_rng(0)
    polygons = [star(n, random) for n in [3000, 2000]]
    points = np.concatenate([*polygons])
    points = np.concatenate([points, np.zeros((len(points), 1))], axis=1)
    start = time.process_time()
    with pytest.raises(InputError, match=r"a\.obj: faces: too many corners of polygons that are not convex"):
        triangulate_polygons(Polygons(points, np.arange(5000), np.array([3000, 2000])), "a.obj")
    assert time.process_time() - start < 1
    circle = np.exp(2j * np.pi * np.arange(3000) / 3000)
    assert len(cut(np.stack([circle.real, circle.imag, 0 * circle.real], axis=1))) == 2998  # convex ones are fans


# A box whose front is a concave hexagon with a notch, as each format writes it.

OUTLINE = np.array([[0, 0], [3, 0], [3, 2], [2, 2], [1.5, 0.5], [1, 2], [0, 2]], float)
N = len(OUTLINE)
PRISM = np.concatenate([np.concatenate([OUTLINE, np.full((N, 1), z)], axis=1) for z in (0.0, 1.0)])
SIDES = [[i, (i + 1) % N, N + (i + 1) % N, N + i] for i in range(N)]
POLYGONS = [list(range(N))[::-1], list(range(N, 2 * N)), *SIDES]


def written(kind):
    rows = [" ".join(f"{x:g}" for x in vertex) for vertex in PRISM]
    if kind == "obj":
        faces = [" ".join(str(i + 1) for i in polygon) for polygon in POLYGONS]
        return "".join([*(f"v {row}\n" for row in rows), *(f"f {face}\n" for face in faces)])
    faces = [" ".join(map(str, [len(polygon), *polygon])) for polygon in POLYGONS]
    if kind == "off":
        return "\n".join([f"OFF\n{len(rows)} {len(faces)} 0", *rows, *faces]) + "\n"
    header = (
        f"ply\nformat ascii 1.0\nelement vertex {len(rows)}\nproperty float x\nproperty float y\nproperty float z\n"
    )
    header += f"element face {len(faces)}\nproperty list uchar int vertex_indices\nend_header\n"
    return header + "\n".join([*rows, *faces]) + "\n"


@pytest.mark.parametrize("kind", ["obj", "ply", "off"])
def test_a_solid_with_concave_sides_keeps_its_volume(kind, tmp_path):
    file = tmp_path / f"a.{kind}"
    file.write_text(written(kind))
    mesh = read_mesh(file)
    np.testing.assert_array_equal(mesh.vertices, PRISM)
    clean = clean_mesh(mesh.vertices, mesh.faces)
    assert clean.report.boundary_loops == clean.report.turned_faces == clean.report.without_area == 0
    solid = trimesh.Trimesh(clean.vertices, clean.faces, process=False)
    assert solid.is_watertight
    np.testing.assert_allclose([solid.volume, solid.area], [area(OUTLINE), prism_area()])
    assert read_polygons(file).lengths.tolist() == [N, N, *[4] * N]


def prism_area():
    return 2 * area(OUTLINE) + np.linalg.norm(OUTLINE - np.roll(OUTLINE, -1, axis=0), axis=1).sum()
