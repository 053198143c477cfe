"""The space that hair fills, and points inside it."""

import numpy as np
import pytest
from hair.hairy_ball import CAP, RADIUS, STANDOFF, ball, views

from carigs.hair import place_in_hair
from carigs.hair.covered_faces import Covering, covered_faces
from carigs.hair.hull import Voxels
from carigs.hair.strands import strand_directions
from carigs.hair.visible_voxels import visible_shares
from carigs.hair.volume import below_hair, carve_hair


@pytest.fixture(scope="module")
def seen():
    return list(views(count=24))


@pytest.fixture(scope="module")
def cap():
    vertices, faces = ball()
    return vertices[faces].mean(axis=1)[:, 1] > CAP * RADIUS


@pytest.fixture(scope="module")
def volume(seen, cap):
    vertices, faces = ball()
    none = np.zeros(len(faces), bool)
    covering = covered_faces(seen, faces, vertices, cap, none, none)
    return carve_hair(seen, covering, cap, vertices, faces)


def test_hair_is_found_between_the_skin_and_the_strands_and_nowhere_else(volume):
    radius, height = np.linalg.norm(volume.centres, axis=1), volume.centres[:, 1]
    solid = volume.opacity > 0.5
    assert solid.sum() > 500
    # A visual hull is larger than what it is the hull of: by the voxels, and where few views see the outline.
    assert np.quantile(radius[solid], 0.98) < RADIUS + STANDOFF + 2 * volume.size
    assert radius[solid].min() > RADIUS - volume.size
    assert (height[solid] > CAP * RADIUS - 0.01).mean() > 0.98
    # Every part of the shell over the cap, but for the top that no camera looks at, has voxels.
    directions = np.random.default_rng(0).normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    shell = (RADIUS + STANDOFF / 2) * directions[(directions[:, 1] > CAP + 0.1) & (directions[:, 1] < 0.7)]
    distance = np.sqrt(((shell[:, None] - volume.centres[solid]) ** 2).sum(axis=2).min(axis=1))
    assert np.quantile(distance, 0.95) < 2.5 * volume.size


def test_a_bald_head_has_no_hair(cap):
    vertices, faces = ball()
    bald = Covering(np.zeros(len(faces)), np.full((len(faces), 3), 0.5), *3 * [np.zeros(len(faces), bool)])
    found = carve_hair(list(views(hair=False)), bald, cap, vertices, faces)
    assert found.opacity.sum() < 20  # the blur of the outline


def test_hair_follows_the_scalp_when_the_head_moves(seen, cap, volume):
    """The same voxels in the axes of the head, wherever head and cameras are."""
    from dataclasses import replace

    from scipy.spatial.transform import Rotation

    from carigs.raster import compute_visibility

    vertices, faces = ball()
    none = np.zeros(len(faces), bool)
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = Rotation.from_rotvec([0.3, -0.5, 0.2]).as_matrix(), [0.2, -0.1, 0.4]
    moved = []
    for view in seen:
        camera = view.visibility.camera
        camera = replace(camera, camera_from_world=camera.camera_from_world @ np.linalg.inv(motion))
        posed = vertices @ motion[:3, :3].T + motion[:3, 3]
        moved.append(view._replace(visibility=compute_visibility(posed, faces, camera)))
    covering = covered_faces(moved, faces, vertices, cap, none, none)
    again = carve_hair(moved, covering, cap, vertices, faces)
    assert len(again.centres) == pytest.approx(len(volume.centres), rel=0.02)
    assert again.opacity.sum() == pytest.approx(volume.opacity.sum(), rel=0.02)


def test_points_lie_in_the_hair_where_it_is_seen_on_the_nearest_triangle_of_the_scalp(seen, cap, volume):
    vertices, faces = ball()
    visible = visible_shares(volume, seen, vertices, np.unique(faces[cap]))
    assert visible.min() >= 0 and 0.2 < visible.max() <= 1
    radius = np.linalg.norm(volume.centres, axis=1)
    outer = (volume.opacity > 0.5) & (radius > RADIUS + STANDOFF - volume.size)
    inner = (volume.opacity > 0.5) & (radius < RADIUS + 0.5 * volume.size)
    assert np.median(visible[outer]) > np.median(visible[inner])
    strands = strand_directions(volume, seen, vertices, np.unique(faces[cap]))
    points = place_in_hair(volume, visible, strands, cap, vertices, faces, 3000, np.random.default_rng(0))
    assert len(points.face) == 3000 and cap[points.face].all() and (points.spacing > 0).all()
    offset = np.abs(points.position[:, None] - volume.centres[None, volume.opacity > 0]).max(axis=2).min(axis=1)
    assert offset.max() <= volume.size / 2 + 1e-6
    # The nearest triangle of a ball is the one that the point stands over.
    normal = vertices[faces[points.face]].mean(axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    direction = points.position / np.linalg.norm(points.position, axis=1, keepdims=True)
    over = direction[:, 1] > CAP + 0.1
    assert np.degrees(np.arccos(np.einsum("nc,nc->n", normal, direction)[over].clip(-1, 1))).max() < 6
    again = place_in_hair(volume, visible, strands, cap, vertices, faces, 3000, np.random.default_rng(0))
    np.testing.assert_array_equal(points.position, again.position)


def test_hair_hides_the_skin_near_it_alone(volume, cap):
    vertices, faces = ball()
    below, height = below_hair(volume, vertices, faces), vertices[faces].mean(axis=1)[:, 1]
    assert below[height > (CAP + 0.1) * RADIUS].mean() > 0.95 and not below[height < CAP * RADIUS - 0.03].any()
    none = Voxels(np.zeros((0, 3), np.float32), np.zeros(0, np.float32), 0.004)
    assert not below_hair(none, vertices, faces).any()
