"""How far hair reaches from the scalp."""

import numpy as np
import pytest
from surfaces import sphere

from carigs.hair import hair_reach
from carigs.mesh.carried_points import CarriedPoints


def hair_of(position, face) -> CarriedPoints:
    n = len(face)
    return CarriedPoints(face, position, np.full(n, 0.002), np.zeros((n, 3, 2)), np.ones(n))


@pytest.mark.parametrize("length", [0.002, 0.03])
def test_a_layer_at_one_height_reaches_as_far(length):
    vertices, faces = sphere(4, 0.1)
    centres = vertices[faces].mean(axis=1)
    scalp = centres[:, 1] > 0
    carrier = np.flatnonzero(scalp)
    outwards = centres[carrier] / np.linalg.norm(centres[carrier], axis=1, keepdims=True)
    reach = hair_reach(hair_of(centres[carrier] + length * outwards, carrier), scalp, vertices, faces)
    np.testing.assert_allclose(reach[scalp], length, rtol=1e-9)
    assert not reach[~scalp].any()


def test_hair_that_is_long_on_one_side_reaches_far_there_alone():
    vertices, faces = sphere(4, 0.1)
    centres = vertices[faces].mean(axis=1)
    scalp = centres[:, 1] > 0
    carrier = np.flatnonzero(scalp).repeat(6)
    length = np.where(centres[carrier, 0] > 0, 0.08, 0.005)
    outwards = centres[carrier] / np.linalg.norm(centres[carrier], axis=1, keepdims=True)
    reach = hair_reach(hair_of(centres[carrier] + length[:, None] * outwards, carrier), scalp, vertices, faces)
    np.testing.assert_allclose(reach[scalp & (centres[:, 0] > 0.03)], 0.08, rtol=1e-9)
    np.testing.assert_allclose(reach[scalp & (centres[:, 0] < -0.03)], 0.005, rtol=1e-9)


def test_few_points_and_none():
    vertices, faces = sphere(2, 0.1)
    scalp = vertices[faces].mean(axis=1)[:, 1] > 0
    face = np.flatnonzero(scalp)[:3]
    position = vertices[faces[face]].mean(axis=1) + np.array([[0.01, 0, 0], [0, 0.02, 0], [0, 0, 0.03]])
    np.testing.assert_allclose(hair_reach(hair_of(position, face), scalp, vertices, faces)[scalp], 0.02)
    assert not hair_reach(hair_of(position[:0], face[:0]), scalp, vertices, faces).any()
    assert not hair_reach(hair_of(position, face), np.zeros_like(scalp), vertices, faces).any()
