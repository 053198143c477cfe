"""Rigid alignment: exact for moved points, and no mirror image."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from carigs.mesh.rigid_alignment import rigid_alignment


@pytest.mark.parametrize("seed", range(5))
def test_a_rigid_motion_is_found(seed):
    random = np.random.default_rng(seed)
    source, weights = random.normal(size=(7, 3)), random.uniform(0.1, 1, 7)
    expected, shift = Rotation.random(rng=random).as_matrix(), random.normal(size=3)
    rotation, translation = rigid_alignment(source, source @ expected.T + shift, weights)
    np.testing.assert_allclose(rotation, expected, atol=1e-12)
    np.testing.assert_allclose(translation, shift, atol=1e-12)


def test_a_mirror_image_is_met_by_a_rotation():
    source = np.random.default_rng(1).normal(size=(9, 3))
    rotation, _ = rigid_alignment(source, source * [-1, 1, 1], np.ones(9))
    np.testing.assert_allclose(np.linalg.det(rotation), 1, atol=1e-12)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)


def test_points_of_weight_0_do_not_count():
    random = np.random.default_rng(2)
    source, expected = random.normal(size=(8, 3)), Rotation.from_rotvec([0.3, -1, 0.2]).as_matrix()
    target = source @ expected.T
    target[0] += 10
    rotation, _ = rigid_alignment(source, target, np.array([0.0, *np.ones(7)]))
    np.testing.assert_allclose(rotation, expected, atol=1e-12)
