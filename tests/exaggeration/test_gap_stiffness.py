"""Stiffness of the gap between two plates against its closed form."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from carigs.exaggeration.gap_stiffness import MAX_GAP, MIN_GAP, gap_stiffness
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
def test_the_gap_between_plates_is_an_elastic_column(gap):
    """Lifting one plate has the energy |u|^2 / t^2 on both unit areas, faded at MAX_GAP and bounded below MIN_GAP."""
    vertices, faces, upper = plates(gap)
    stiffness, extent = gap_stiffness(vertices, faces), size(vertices, faces)
    narrow, reach = (MIN_GAP * extent) ** 2, (MAX_GAP * extent) ** 2
    expected = 2 * (1 / (gap**2 + narrow) - 1 / (reach + narrow)) if gap < MAX_GAP * extent else 0.0
    lift = upper.astype(float)
    assert lift @ (stiffness @ lift) == pytest.approx(expected, rel=1e-6)
    np.testing.assert_allclose(stiffness @ np.ones(len(lift)), 0, atol=1e-9 * max(expected, 1))
    assert abs(stiffness - stiffness.T).max() <= 1e-12 * max(expected, 1)


def test_plates_back_to_back_have_no_gap():
    vertices, faces, _ = plates(5e-3)
    assert gap_stiffness(vertices, faces[:, ::-1]).nnz == 0


@given(st.floats(-6, 6), st.tuples(*[st.floats(-3, 3)] * 3))
def test_gap_stiffness_does_not_depend_on_unit_and_rotation(exponent, rotation_vector):
    vertices, faces, _ = plates(5e-3, n=4)
    turned = 10.0**exponent * vertices @ Rotation.from_rotvec(rotation_vector).as_matrix().T
    expected, found = gap_stiffness(vertices, faces).toarray(), gap_stiffness(turned, faces).toarray()
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())
