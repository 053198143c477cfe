"""The derivative of the exponential map, against complex steps through the matrix exponential."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from carigs.fitting.rotation_vectors import left_jacobians

vectors = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)


def cross_matrix(v: np.ndarray) -> np.ndarray:
    return np.array([[0, -v[2], v[1]], [v[2], 0, -v[0]], [-v[1], v[0], 0]])


@given(vectors, st.sampled_from([1.0, 1e-2, 1e-3, 1e-8, 0.0]))
def test_it_is_the_derivative_of_the_matrix_exponential(vector, scale):
    vector = scale * vector
    rotation, step = expm(cross_matrix(vector)), 1e-30
    for k, column in enumerate(left_jacobians(vector).T):
        derivative = expm(cross_matrix(vector + 1j * step * np.eye(3)[k])).imag / step
        np.testing.assert_allclose(derivative, cross_matrix(column) @ rotation, atol=1e-11)


def test_arrays_of_vectors_are_differentiated_one_by_one():
    many = np.random.default_rng(0).normal(size=(4, 5, 3))
    one_by_one = np.array([[left_jacobians(vector) for vector in row] for row in many])
    np.testing.assert_allclose(left_jacobians(many), one_by_one, atol=1e-15)
