"""Which deformations are refused or warned of."""

import warnings

import numpy as np
import pytest
import trimesh

from carigs.errors import CarigsWarning, MeshError
from carigs.mesh.deformation import check_deformation, turned_faces
from carigs.mesh.self_intersection import self_intersecting_faces

BALL = trimesh.creation.icosphere(subdivisions=2)
V, F = np.asarray(BALL.vertices), np.asarray(BALL.faces)
UNCUT = np.zeros(len(F), bool)


def test_faces_turn_when_a_vertex_is_pushed_through():
    moved = V.copy()
    moved[0] *= -0.5
    np.testing.assert_array_equal(turned_faces(V, moved, F), (F == 0).any(axis=1))
    assert not turned_faces(V, 3 * V + [5, 0, 0], F).any()


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e3, -1e200])
@pytest.mark.parametrize("unit", [1e-6, 1.0, 1e6])
def test_what_is_not_finite_or_absurdly_far_is_refused(value, unit):
    displacement = np.zeros_like(V)
    displacement[7, 1] = value * unit
    with pytest.raises(MeshError, match="level 2: vertex 7 moves by"):
        check_deformation(unit * V, displacement, F, "level 2", UNCUT)


def test_a_fold_is_warned_of_and_a_growth_is_not():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_deformation(V, 4 * V, F, "level 1", UNCUT)  # the size of a literal solve in metres
    with pytest.warns(CarigsWarning, match="level 1: the surface folds: 72 % of the faces turn over; a level"):
        check_deformation(V, V * [-2, 0, 0], F, "level 1", UNCUT)


def test_new_cuts_are_warned_of_and_old_ones_are_not():
    displacement = np.zeros_like(V)
    displacement[0] = -1.7 * 1.5 * V[0]
    cut = self_intersecting_faces(V + displacement, F)
    with pytest.warns(CarigsWarning, match="% of the faces newly cut others"):
        check_deformation(V, displacement, F, "level 1", UNCUT)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_deformation(V + displacement, 0 * V, F, "level 0", cut)
