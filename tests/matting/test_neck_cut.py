"""Mattes that end at the neck, on a column that stands for a head with a neck."""

import numpy as np
import pytest

from carigs.capture import Camera
from carigs.capture.camera import look_at
from carigs.matting.neck_cut import BELOW_CHIN, FADE, NeckCut

CAMERA = Camera(look_at(np.array([0, 0, 1.0]), np.zeros(3)), 400, 400, 128, 128, 256, 256)
CHIN = 0.0


def column(rows=41, around=24, radius=0.06):
    """A tube from -20 to 20 cm, whose triangles face outwards."""
    y, angle = np.linspace(-0.2, 0.2, rows), np.linspace(0, 2 * np.pi, around, endpoint=False)
    vertices = np.stack(
        [np.tile(radius * np.cos(angle), rows), np.repeat(y, around), np.tile(radius * np.sin(angle), rows)], axis=1
    )
    corner = (np.arange(rows - 1)[:, None] * around + np.arange(around)).ravel()
    right = (np.arange(rows - 1)[:, None] * around + (np.arange(around) + 1) % around).ravel()
    faces = [np.stack([corner, corner + around, right], 1), np.stack([right, corner + around, right + around], 1)]
    return vertices, np.concatenate(faces).astype(np.int32)


def row_of(y):
    """The row of the image in which points in front of the camera at height y lie on the column's near side."""
    return int(128 - 400 * y / (1.0 - 0.06))


def test_the_head_stays_and_what_is_below_goes():
    vertices, faces = column()
    share = NeckCut(vertices, faces, CHIN).kept_share(vertices, CAMERA)
    assert share.shape == (256, 256)
    assert share[: row_of(CHIN - BELOW_CHIN + FADE) - 3] == pytest.approx(1, abs=1e-6)
    assert share[row_of(CHIN - BELOW_CHIN) + 3 :].max() < 1e-4
    middle = share[:, 128]
    assert (np.diff(middle) <= 1e-6).all() and ((middle > 0.1) & (middle < 0.9)).any()


@pytest.mark.parametrize("shift", [-0.05, 0.04])
def test_the_cut_moves_with_the_head(shift):
    vertices, faces = column()
    cut = NeckCut(vertices, faces, CHIN)
    share = cut.kept_share(vertices + np.array([0, shift, 0]), CAMERA)
    edges = [int(np.flatnonzero(share[:, x] < 0.5)[0]) for x in (20, 128, 230)]  # beside the head, on it
    assert abs(edges[1] - row_of(shift + CHIN - BELOW_CHIN + FADE / 2)) <= 2
    assert max(edges) - min(edges) <= 3


def test_a_chin_on_the_chest_is_kept():
    vertices, faces = column()
    cut = NeckCut(vertices, faces, CHIN)
    bent = vertices.copy()
    head = vertices[:, 1] > CHIN - 0.005
    bent[head] += [0, -0.06, 0.05]  # the head moves forward and down, before the neck
    share = cut.kept_share(bent, CAMERA)
    assert share[row_of(-0.045), 128] == pytest.approx(1, abs=1e-6)
    # It ends at the mesh: what is beside it there is chest. The edge is smooth over a pixel or two.
    edge = np.abs(np.diff(share[row_of(-0.045)]))
    assert share[row_of(-0.045), 90] < 1e-6
    assert 0.3 < edge.max() < 0.8


def test_a_head_that_ends_above_the_cut_is_kept_as_it_is():
    vertices, faces = column()
    assert (NeckCut(vertices + np.array([0, 0.3, 0]), faces, CHIN).kept_share(vertices, CAMERA) == 1).all()
