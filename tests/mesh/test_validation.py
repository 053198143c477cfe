"""Defective meshes are refused, with the first bad vertex or face in the message."""

import numpy as np
import pytest
from surfaces import sphere

from carigs.errors import MeshError
from carigs.mesh.validation import check_mesh


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
