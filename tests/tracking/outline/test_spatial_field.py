"""Smooth displacements in space from what is known of them at some points."""

import numpy as np
import pytest
from small_head import small_head

from carigs.tracking.outline.spatial_field import SpatialField

VERTICES = small_head(subdivisions=4).v_template.astype(np.float64)
WIDTH = 0.03
"""Twice that of heads, in metres: the equations are a sixtieth of the work."""
FIELD = SpatialField(VERTICES, np.arange(len(VERTICES)), width=WIDTH)
STRONG = np.eye(3) / 1e-5**2


def wave(points: np.ndarray) -> np.ndarray:
    """Smooth over some centimetres."""
    return 0.004 * np.stack([np.sin(20 * points[:, 1]), np.cos(15 * points[:, 2]), np.sin(15 * points[:, 0])], axis=1)


def fit(known: np.ndarray, information: np.ndarray) -> np.ndarray:
    repeated = np.broadcast_to(information, (len(known), 3, 3))
    weighted = np.einsum("nij,nj->ni", repeated, wave(VERTICES[known]))
    return FIELD.fit(FIELD.values[known], repeated, weighted)


@pytest.mark.parametrize("share", [0.5, 1.0])
def test_a_smooth_displacement_is_found_between_the_points_where_it_is_known(share):
    known = np.random.default_rng(0).permutation(len(VERTICES))[: int(share * len(VERTICES))]
    error = np.linalg.norm(fit(np.sort(known), STRONG) - wave(VERTICES), axis=1)
    assert error.max() < 4e-4


def test_nothing_is_displaced_if_nothing_is_known():
    assert not fit(np.arange(len(VERTICES)), np.zeros((3, 3))).any()


def test_what_is_not_known_stays():
    """Known along x alone, and in front alone."""
    front = np.flatnonzero(VERTICES[:, 2] > 0.05)
    found = fit(front, np.diag([1.0, 0.0, 0.0]) / 1e-5**2)
    assert np.abs(found - wave(VERTICES))[front, 0].max() < 2e-4
    assert not found[:, 1:].any()
    assert np.abs(found[VERTICES[:, 2] < -2 * WIDTH]).max() < 1e-4


def test_inside_and_outside_of_a_thin_wall_move_together():
    """Two sheets that no edge connects, a millimetre apart."""
    outer = VERTICES
    both = np.concatenate([outer, 0.99 * outer])
    field = SpatialField(both, np.arange(len(outer)), width=WIDTH)
    known = np.arange(len(outer))
    weighted = np.einsum("ij,nj->ni", STRONG, wave(outer))
    found = field.fit(field.values[known], np.broadcast_to(STRONG, (len(known), 3, 3)), weighted)
    assert np.abs(found[len(outer) :] - found[: len(outer)]).max() < 3e-4
