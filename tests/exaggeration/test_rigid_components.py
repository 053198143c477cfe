"""Small components move by the similarity transform of what surrounds them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from surfaces import PLAIN, bumpy, sphere

from carigs.exaggeration import Exaggerator
from carigs.exaggeration.rigid_components import umeyama


def test_a_ball_in_a_socket_moves_by_a_similarity():
    """A small sphere inside the surface moves like its surroundings: its shape stays a sphere."""
    vertices, faces = bumpy()
    ball, ball_faces = sphere(2, 0.15)
    centre = np.array([0.0, 0, 0.95])
    solver = Exaggerator(np.vstack([vertices, ball + centre]), np.vstack([faces, ball_faces + len(vertices)]), PLAIN)
    moved = (ball + centre) + solver.solve(0.3)[len(vertices) :]
    radii = np.linalg.norm(moved - moved.mean(axis=0), axis=1)
    assert np.ptp(radii) < 1e-9
    (scale,) = solver.report["follower_scales"]
    assert radii.mean() == pytest.approx(0.15 * scale)


@settings(max_examples=30, deadline=None)
@given(st.floats(0.1, 10), st.tuples(*[st.floats(-3, 3)] * 3), st.tuples(*[st.floats(-5, 5)] * 3))
def test_similarity_is_recovered(scale, rotation_vector, shift):
    points = np.random.default_rng(3).normal(size=(15, 3))
    rotation = Rotation.from_rotvec(rotation_vector).as_matrix()
    fitted_scale, fitted_rotation, fitted_shift = umeyama(points, scale * points @ rotation.T + np.array(shift))
    assert fitted_scale == pytest.approx(scale, rel=1e-9)
    np.testing.assert_allclose(fitted_rotation, rotation, atol=1e-9)
    np.testing.assert_allclose(fitted_shift, shift, atol=1e-8)


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_no_other_scale_fits_better(mirror):
    """Also for a mirror image, which no rotation fits."""
    source = np.random.default_rng(0).normal(size=(30, 3))
    target = 1.3 * source * [mirror, 1, 1] + [0.1, 0.2, 0.3]
    scale, rotation, translation = umeyama(source, target)
    assert np.linalg.det(rotation) == pytest.approx(1)

    def error(factor):
        moved = factor * scale * (source - source.mean(axis=0)) @ rotation.T
        return ((moved - (target - target.mean(axis=0))) ** 2).sum()

    assert error(1) <= min(error(0.99), error(1.01)) + 1e-12
    np.testing.assert_allclose(translation, target.mean(axis=0) - scale * rotation @ source.mean(axis=0))
