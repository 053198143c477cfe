"""Points on a mesh: linear precision, affine invariance, round trips through arrays, refused contents."""

from pathlib import Path

import numpy as np
import pytest
from small_head import small_head

from carigs.errors import InputError
from carigs.head import SurfacePoints
from carigs.head.surface_points import checked_points, points_of_faces

MODEL = small_head(subdivisions=2)
FILE = Path("head.npz")


def random_points(count: int = 20) -> SurfacePoints:
    random = np.random.default_rng(0)
    return SurfacePoints(MODEL.faces[random.choice(len(MODEL.faces), count)], random.dirichlet(np.ones(3), count))


def test_linear_functions_are_reproduced():
    points, matrix = random_points(), np.random.default_rng(1).normal(size=(3, 2, 4))
    values = np.einsum("vi,ijk->vjk", MODEL.v_template.astype(float), matrix) + 3
    expected = np.einsum("ni,ijk->njk", points.interpolate(MODEL.v_template), matrix) + 3
    np.testing.assert_allclose(points.interpolate(values), expected, atol=1e-12)


def test_points_lie_in_their_triangles():
    points = random_points()
    positions, corners = points.interpolate(MODEL.v_template), MODEL.v_template[points.corners].astype(float)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    np.testing.assert_allclose(np.einsum("ni,ni->n", positions - corners[:, 0], normals), 0, atol=1e-12)
    areas = [
        np.linalg.norm(np.cross(corners[:, i - 1] - positions, corners[:, i - 2] - positions), axis=1) for i in range(3)
    ]
    np.testing.assert_allclose(np.sum(areas, axis=0), np.linalg.norm(normals, axis=1), atol=1e-12)


def test_vertices_are_points_with_one_corner():
    vertices = np.array([5, 2, 9])
    points = SurfacePoints.at_vertices(vertices)
    np.testing.assert_array_equal(points.interpolate(MODEL.v_template), MODEL.v_template[vertices])
    np.testing.assert_array_equal(points[1:].interpolate(MODEL.v_template), MODEL.v_template[vertices[1:]])
    as_faces = SurfacePoints(np.stack([vertices] * 3, axis=1), np.tile([0.2, 0.3, 0.5], (3, 1)))
    np.testing.assert_allclose(as_faces.interpolate(MODEL.v_template), MODEL.v_template[vertices], atol=1e-9)


@pytest.mark.parametrize("points", [random_points(), SurfacePoints.at_vertices(np.arange(20))])
def test_arrays_are_read_as_they_were_written(points):
    again = checked_points(points.arrays("landmarks"), "landmarks", 20, len(MODEL.v_template), FILE)
    np.testing.assert_array_equal(again.corners, points.corners)
    np.testing.assert_array_equal(again.barycentric, points.barycentric)


@pytest.mark.parametrize("batch", [False, True])
def test_indices_of_faces_become_their_corners(batch):
    arrays = {"faces": np.array([7, 9]), "coordinates": np.array([[0.2, 0.3, 0.5], [1, 0, 0]])}
    if batch:  # FLAME's files have a leading axis of one
        arrays = {name: array[None] for name, array in arrays.items()}
    points = points_of_faces(arrays, ("faces", "coordinates"), MODEL.faces, FILE)
    np.testing.assert_array_equal(points.corners, MODEL.faces[[7, 9]])
    expected = [[0.2, 0.3, 0.5] @ MODEL.v_template[MODEL.faces[7]], MODEL.v_template[MODEL.faces[9, 0]]]
    np.testing.assert_allclose(points.interpolate(MODEL.v_template), expected, atol=1e-8)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"a": np.zeros((20, 2), int)}, r"head\.npz: a: shape \(20, 2\), expected 20 x 3"),
        ({"a": np.zeros((19, 3), int)}, r"head\.npz: a: shape \(19, 3\)"),
        ({"a": np.full((20, 3), 10**6)}, r"head\.npz: a: indices must lie in"),
        ({"a_barycentric": np.full((20, 3), 0.5)}, r"a_barycentric: the coordinates of point 0 add up to 1\.5"),
        ({"a_barycentric": np.full((20, 3), np.nan)}, "a_barycentric: not a finite number"),
    ],
)
def test_points_that_cannot_be_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        checked_points(random_points().arrays("a") | change, "a", 20, len(MODEL.v_template), FILE)
