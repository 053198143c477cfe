"""Where hair is on a caricature."""

import numpy as np
from hair.hairy_ball import CAP, RADIUS, ball, cameras

from carigs.hair import CarriedHair, FoundHair
from carigs.hair.hull import Voxels
from carigs.hair.strands import Strands
from carigs.raster import compute_visibility


def carried(points, scalp, opacity=1.0, visible=1.0):
    vertices, faces = ball()
    n, none = len(points), np.zeros(len(faces), bool)
    points = np.asarray(points, np.float32)
    volume = Voxels(points, np.full(n, opacity, np.float32), 0.004)
    strands = Strands(points, np.zeros(n, np.float32), points)
    found = FoundHair(
        np.zeros(len(faces), np.float32), none, none, none, volume, np.full(n, visible, np.float32), strands
    )
    return CarriedHair(found, scalp, vertices, faces, 30.0)


def cap():
    vertices, faces = ball()
    return vertices[faces].mean(axis=1)[:, 1] > CAP * RADIUS


def test_voxels_move_with_the_scalp_below_them():
    """The caricature shifts the whole ball: the hair is shifted as it is, whichever way the head has moved."""
    vertices, faces = ball()
    camera = next(cameras())
    points = np.array([[0.004, 0.07, 0.08], [0.021, 0.06, 0.09]])
    hair = carried(points, cap())
    for motion in (np.zeros(3), np.array([0.05, 0.02, -0.1])):
        natural = compute_visibility(vertices + motion, faces, camera)
        for shift in (np.zeros(3), np.array([0.03, 0.01, 0.02])):
            shown = hair.pixels(natural, compute_visibility(vertices + motion + shift, faces, camera))
            pixels = np.floor(camera.project(points + motion + shift)[0]).astype(int)
            expected = np.zeros_like(shown)
            expected[pixels[:, 1], pixels[:, 0]] = True
            np.testing.assert_array_equal(shown, expected)


def test_only_the_scalp_carries():
    """The lower half of the ball grows, and the hair above it stays."""
    vertices, faces = ball()
    camera = next(cameras())
    seen = compute_visibility(vertices, faces, camera)
    grown = vertices * np.where(vertices[:, 1:2] < 0, 1.5, 1.0)
    hair = carried([[0.004, 0.08, 0.07], [0.004, -0.05, 0.08]], cap())
    np.testing.assert_array_equal(hair.pixels(seen, compute_visibility(grown, faces, camera)), hair.pixels(seen, seen))


def test_faint_voxels_hidden_ones_and_heads_without_hair_have_none():
    vertices, faces = ball()
    seen = compute_visibility(vertices, faces, next(cameras()))
    points = [[0.004, 0.07, 0.08]]
    assert carried(points, cap()).pixels(seen, seen).sum() == 1
    for hair in (
        carried(points, cap(), opacity=0.2), carried(points, cap(), visible=0.0),
        carried(points, np.zeros(len(faces), bool)), carried(np.zeros((0, 3)), cap()),
    ):  # fmt: skip
        assert not hair.pixels(seen, seen).any()
