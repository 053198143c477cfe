"""Before two cameras, hair is as high where no view looks along the head as where one does."""

import numpy as np
import pytest
from hair import hairy_ball
from hair.hairy_ball import CAP, RADIUS, SIZE, STANDOFF, ball, views

from carigs.capture import Camera, look_at
from carigs.hair import volume
from carigs.hair.covered_faces import covered_faces
from carigs.hair.hair_height import UNMEASURED, hair_heights
from carigs.hair.hull import FINE, hull_views
from carigs.hair.measured_reach import GRAZING
from carigs.hair.views import some_views

HIGHEST = (RADIUS + STANDOFF) / np.sqrt(1 - GRAZING**2) - RADIUS
"""Of the hull of the ball of hair where views measure it."""


def from_two_sides(count):
    """Two cameras 83 degrees apart, in turns."""
    for i in range(count):
        azimuth = np.radians((-41.5, 41.5)[i % 2])
        centre = 0.9 * np.array([np.sin(azimuth), 0.2, np.cos(azimuth)])
        yield Camera(look_at(centre, np.zeros(3)), 650.0, 650.0, SIZE / 2, SIZE / 2, SIZE, SIZE)


def with_shirt(view):
    """Something that fills the image from the middle of the ball down to its edge."""
    matte = view.foreground.copy()
    matte[SIZE // 2 :] = 1
    return view._replace(foreground=matte)


@pytest.fixture
def two_cameras(monkeypatch):
    """Views, cap, what covers the triangles, vertices and triangles."""
    monkeypatch.setattr(hairy_ball, "cameras", from_two_sides)
    vertices, faces = ball()
    cap = vertices[faces].mean(axis=1)[:, 1] > CAP * RADIUS
    seen, none = [with_shirt(view) for view in views(count=8)], np.zeros(len(faces), bool)
    return seen, cap, covered_faces(seen, faces, vertices, cap, none, none), vertices, faces


def test_the_corners_of_an_open_hull_are_no_hair(two_cameras, monkeypatch):
    seen, cap, covering, vertices, faces = two_cameras

    def highest():
        carved = volume.carve_hair(seen, covering, cap, vertices, faces)
        assert (carved.opacity > 0.5).sum() > 500
        return (np.linalg.norm(carved.centres, axis=1) - RADIUS).max()

    assert highest() < HIGHEST + FINE
    monkeypatch.setattr(volume, "WIDE", 180.0)  # as if they were near each other
    assert highest() > 1.5 * HIGHEST


def heights(two_cameras, bare):
    seen, cap, covering, vertices, faces = two_cameras
    looks = hull_views(seen, covering.opacity(0.03), vertices, np.unique(faces[cap]))
    return hair_heights(looks, cap, bare, vertices, faces)


def test_hair_ends_above_bare_skin(two_cameras):
    _, cap, *_ = two_cameras
    height = heights(two_cameras, ~cap)
    assert np.isclose(np.quantile(height[cap], 0.95), STANDOFF, atol=FINE) and height[cap].max() < HIGHEST + FINE
    vertices, faces = two_cameras[-2:]
    far = vertices[faces].mean(axis=1)[:, 1] < (CAP - 0.2) * RADIUS
    assert (height[far] == 0).all()


def test_what_is_covered_beside_the_scalp_is_at_most_as_high(two_cameras):
    _, cap, *_ = two_cameras
    height = heights(two_cameras, np.zeros(len(cap), bool))
    assert height[~cap].max() <= height[cap].max()
    assert np.median(height[~cap]) < 0.5 * STANDOFF  # views along the ball show that nothing stands off it there


def test_where_no_view_measures_hair(two_cameras):
    seen, cap, covering, vertices, faces = two_cameras
    looks = hull_views(seen, covering.opacity(0.03), vertices, np.unique(faces[cap]))
    front = cap & (vertices[faces].mean(axis=1)[:, 2] > 0.9 * RADIUS)  # seen, but from the front
    height = hair_heights(looks, front, ~front, vertices, faces)
    assert np.allclose(height[front], UNMEASURED)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 6, 8, 9, 16])
def test_some_views_are_of_all_cameras(count, monkeypatch):
    rig = list(hairy_ball.cameras(count))
    monkeypatch.setattr(hairy_ball, "cameras", lambda total: (rig[i % count] for i in range(total)))
    seen = list(views(hair=False, count=9 * count, scale=0.1))
    some = some_views(seen)
    assert len(some) <= -(-len(seen) // 4)
    assert len({view.visibility.camera.camera_from_world.tobytes() for view in some}) == min(count, len(some))
