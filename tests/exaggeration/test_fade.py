"""A path that fades out towards the border of a mesh."""

from dataclasses import replace

import numpy as np
import pytest
from surfaces import sphere

from carigs.exaggeration import straight_path
from carigs.exaggeration.fade import faded_path

VERTICES, FACES = sphere(3, 0.1)
LOW = np.flatnonzero(VERTICES[:, 1] < -0.08)


@pytest.fixture
def path():
    random = np.random.default_rng(0)
    plain = straight_path(VERTICES, FACES, random.normal(0, 0.01, VERTICES.shape), 0.25)
    changes = random.normal(0, 0.01, (1, 2, *VERTICES.shape)).astype(np.float32)
    return replace(plain, columns=np.array([0, 3]), changes=changes)


def test_fixed_vertices_stay_and_far_ones_move_as_before(path):
    faded = faded_path(path, LOW, 0.05)
    far = VERTICES[:, 1] > -0.02  # farther than 5 cm along any line
    for level in (0.1, 0.25):
        before, after = path.at(level), faded.at(level)
        assert np.abs(after.displacement[LOW]).max() == 0 and np.abs(after.changes[:, LOW]).max() == 0
        np.testing.assert_array_equal(after.displacement[far], before.displacement[far])
        np.testing.assert_array_equal(after.changes[:, far], before.changes[:, far])


def test_in_between_the_share_grows_with_the_distance(path):
    share = faded_path(path, LOW, 0.1).displacement(0.25) / path.displacement(0.25)
    np.testing.assert_allclose(share, share[:, :1].repeat(3, axis=1), rtol=1e-4, atol=1e-6)
    assert ((share >= -1e-6) & (share <= 1 + 1e-6)).all()
    height = VERTICES[:, 1]
    rings = [share[np.abs(height - h) < 0.004, 0].mean() for h in (-0.07, -0.05, -0.03, 0.0)]
    assert (np.diff(rings) > 0).all()


def test_nothing_fades_without_fixed_vertices(path):
    assert faded_path(path, LOW[:0], 0.05) is path
