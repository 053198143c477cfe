"""Functions on 3x3 matrices inside kernels."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from carigs.simd import matrix3
from carigs.simd.kernels import kernel
from carigs.simd.tuples import write_row


@kernel
def _rotation_vectors(rotations, vectors):
    for i in range(len(rotations)):
        write_row(vectors, i, matrix3.rotation_vector(matrix3.load(rotations, i)))


@given(st.integers(0, 2**32 - 1), st.one_of(st.floats(-12, -1), st.floats(0.1, 3.14).map(np.log10)))
def test_rotation_vectors_invert_the_exponential_at_any_angle(seed, exponent):
    axis = np.random.default_rng(seed).normal(size=3)
    expected = 10**exponent * axis / np.linalg.norm(axis)
    found = np.empty((1, 3))
    _rotation_vectors(Rotation.from_rotvec(expected).as_matrix()[None], found)
    np.testing.assert_allclose(found[0], expected, rtol=0, atol=1e-14 + 1e-14 * 10**exponent)


def test_the_angle_is_smooth_where_the_series_of_the_arctangent_ends():
    angles = 2 * np.arctan(np.sqrt(0.05)) + np.linspace(-1e-3, 1e-3, 101)
    found = np.empty((len(angles), 3))
    _rotation_vectors(Rotation.from_rotvec(angles[:, None] * [0, 0.6, 0.8]).as_matrix(), found)
    np.testing.assert_allclose(np.linalg.norm(found, axis=1), angles, rtol=1e-14)
