"""Rotations of polar decompositions, eight at a time."""

import numpy as np
from scipy.linalg import polar

from carigs.simd import matrix3
from carigs.simd.kernels import kernel
from carigs.simd.polar_wide import BLOCK, WIDE, load_matrix, polar_rotations, store_matrix


@kernel
def _rotations(matrices, rotations):
    block = np.empty(BLOCK)
    for r in range(WIDE):
        store_matrix(block, r, matrix3.load(matrices, r))
    polar_rotations(block)
    for r in range(WIDE):
        matrix3.store(rotations, r, load_matrix(block, r))


def rotations_of(matrices):
    rotations = np.empty_like(matrices)
    _rotations(matrices, rotations)
    return rotations


def random_matrices(seed, size=1.0):
    matrices = size * np.random.default_rng(seed).normal(size=(WIDE, 3, 3))
    matrices[np.linalg.det(matrices) < 0, 0] *= -1
    return matrices


def test_they_are_the_rotations_of_the_polar_decomposition():
    for seed, size in ((0, 1.0), (1, 1e-3), (2, 1e6)):
        matrices = random_matrices(seed, size)
        expected = np.array([polar(m)[0] for m in matrices])
        np.testing.assert_allclose(rotations_of(matrices), expected, atol=1e-12)


def test_a_rotation_is_its_own():
    rotations = rotations_of(random_matrices(3))
    np.testing.assert_allclose(rotations_of(3.0 * rotations), rotations, atol=1e-14)
    np.testing.assert_allclose(rotations @ rotations.transpose(0, 2, 1), np.tile(np.eye(3), (WIDE, 1, 1)), atol=1e-14)


def test_a_matrix_does_not_depend_on_its_neighbours():
    matrices, others = random_matrices(4), random_matrices(5, 1e4)
    others[2] = matrices[2]
    others[5] = np.nan
    np.testing.assert_array_equal(rotations_of(others)[2], rotations_of(matrices)[2])
