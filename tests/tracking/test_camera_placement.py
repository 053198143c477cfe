"""Cameras placed by the head, with wrong poses among right ones; and which cameras can be placed."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from carigs.tracking.camera_placement import linked, place_cameras, rigid_mean


def rigid(rng, count, turn=0.5, shift=0.3):
    found = np.tile(np.eye(4), (count, 1, 1))
    found[:, :3, :3] = Rotation.from_rotvec(turn * rng.normal(size=(count, 3))).as_matrix()
    found[:, :3, 3] = shift * rng.normal(size=(count, 3))
    return found


@pytest.mark.parametrize("seed", range(3))
def test_cameras_and_heads_are_those_that_made_the_poses(seed):
    rng = np.random.default_rng(seed)
    cameras, heads = rigid(rng, 4), rigid(rng, 20)
    cameras[0] = np.eye(4)
    seen = cameras[None] @ heads[:, None]
    seen[:12, 1] = np.nan  # the second camera sees the head with the third one alone
    seen[12:, 0] = np.nan
    seen[3, 2] = rigid(rng, 1)[0]  # a wrong pose
    found, placed = place_cameras(seen)
    np.testing.assert_allclose(found, cameras, atol=1e-9)
    np.testing.assert_allclose(np.delete(placed, 3, axis=0), np.delete(heads, 3, axis=0), atol=1e-9)


def test_a_camera_that_nothing_links_has_no_place():
    rng = np.random.default_rng(0)
    seen = rigid(rng, 3)[None] @ rigid(rng, 6)[:, None]
    seen[:3, 2] = np.nan
    seen[3:, :2] = np.nan
    found, placed = place_cameras(seen)
    assert np.isfinite(found[:2]).all() and np.isnan(found[2]).all() and np.isnan(placed[3:]).all()
    assert linked(np.isfinite(seen[:, :, 0, 0])).tolist() == [True, True, False]


def test_cameras_are_linked_through_others():
    seen = np.array([[1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1]], bool)
    assert linked(seen).all()
    assert linked(seen[:2]).tolist() == [True, True, True, False]


def test_the_mean_of_rotations_does_not_depend_on_their_frame():
    rng = np.random.default_rng(1)
    transforms, [turn] = rigid(rng, 9, turn=0.1), rigid(rng, 1)
    np.testing.assert_allclose(
        rigid_mean(turn @ transforms)[:3, :3], turn[:3, :3] @ rigid_mean(transforms)[:3, :3], atol=1e-12
    )
