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
