"""Hair is no thicker where all views look at it from the front than where they see its outline."""

import numpy as np
import pytest
from hair import hairy_ball
from hair.hairy_ball import CAP, RADIUS, SIZE, STANDOFF, ball, views

from carigs.capture import Camera, look_at
from carigs.hair.covered_faces import Covering, covered_faces
from carigs.hair.volume import carve_hair


def in_front(count):
    """Cameras within 30 degrees of the front."""
    for i in range(count):
        azimuth = np.radians(60 * i / (count - 1) - 30)
        centre = 0.9 * np.array([np.sin(azimuth), (0.15, 0.3, -0.1)[i % 3], np.cos(azimuth)])
        yield Camera(look_at(centre, np.zeros(3)), 650.0, 650.0, SIZE / 2, SIZE / 2, SIZE, SIZE)


@pytest.mark.parametrize(("cameras", "most"), [(None, 2 * STANDOFF), (in_front, 4 * STANDOFF)])
def test_hair_does_not_reach_towards_the_cameras(cameras, most, monkeypatch):
    """A visual hull alone reaches 0.25 m, to the end of the grid, where views come from one side."""
    if cameras is not None:
        monkeypatch.setattr(hairy_ball, "cameras", cameras)
    vertices, faces = ball()
    cap = vertices[faces].mean(axis=1)[:, 1] > CAP * RADIUS
    none = np.zeros(len(faces), bool)
    seen = list(views(count=24))
    volume = carve_hair(seen, covered_faces(seen, faces, vertices, cap, none, none), cap, vertices, faces)
    height = np.linalg.norm(volume.centres, axis=1) - RADIUS
    assert (volume.opacity > 0.5).sum() > 500
    assert height.max() < most


def test_what_does_not_hang_together_with_the_scalp_is_no_hair(monkeypatch):
    """Stubble, lips or brows look covered, and no view from the front bounds the hull before them."""
    monkeypatch.setattr(hairy_ball, "cameras", in_front)
    vertices, faces = ball()
    x, y, z = vertices[faces].mean(axis=1).T
    cap, stubble = y > CAP * RADIUS, (z > 0) & (np.abs(x) < 0.03) & (np.abs(y + 0.04) < 0.03)
    covered, nothing = cap | stubble, np.zeros(len(faces), bool)
    covering = Covering(0.1 * covered, np.full((len(faces), 3), 0.5), covered, nothing, nothing)
    seen = list(views(count=24))
    volume = carve_hair(seen, covering, cap, vertices, faces)
    assert (volume.opacity > 0.5).sum() > 500
    assert volume.centres[:, 1].min() > CAP * RADIUS - 2 * volume.size
    alone = carve_hair(seen, covering, cap | stubble, vertices, faces)  # where it counts as scalp, it carries hair
    assert ((alone.opacity > 0.5) & (alone.centres[:, 1] < 0)).sum() > 100
