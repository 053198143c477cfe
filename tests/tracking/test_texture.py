"""Corners that are followed: a picture that is shifted, and skin that moves by itself."""

import cv2
import numpy as np

from carigs.tracking.texture.corners import CELL, HeadImage, follow_texture

SIDE, SHIFT = 200, np.array([2.0, 1.0])


def picture(seed=0):
    rough = np.random.default_rng(seed).random((SIDE, SIDE))
    grey = cv2.GaussianBlur(rough, (0, 0), 2.0)
    return np.uint8(255 * (grey - grey.min()) / np.ptp(grey))


def shifted(count=12):
    """A textured head that moves, on a grid of vertices."""
    base = picture()
    images = []
    for t in range(count):
        moved = cv2.warpAffine(base, np.float32([[1, 0, SHIFT[0] * t], [0, 1, SHIFT[1] * t]]), (SIDE, SIDE))
        images.append(np.repeat(moved[..., None], 3, 2))
    x, y = np.meshgrid(np.arange(40.0, 141, 2), np.arange(40.0, 141, 2))
    grid = np.column_stack([x.ravel(), y.ravel()])
    pixels = grid + SHIFT * np.arange(count)[:, None, None]
    rest = np.column_stack([grid / 1000, np.zeros(len(grid))])
    shown = np.ones(pixels.shape[:2], bool)
    return images, HeadImage(pixels, shown, grid[:, 0] < 100, rest)


def test_corners_go_with_the_picture():
    images, head = shifted()
    tracks = follow_texture(images, head)
    assert len(tracks.vertex) >= 20
    for corner in range(len(tracks.vertex)):
        own = tracks.corner == corner
        steps = np.diff(tracks.pixels[own], axis=0) / np.diff(tracks.frame[own])[:, None]
        # The equalised contrast is not shifted exactly.
        np.testing.assert_allclose(np.median(steps, axis=0), SHIFT, atol=0.15)


def test_skin_that_moves_by_itself_is_left_out():
    images, head = shifted()
    tracks = follow_texture(images, head)
    at_rest = tracks.pixels - SHIFT * tracks.frame[:, None]
    assert at_rest[:, 0].max() < 100  # left of the vertices that are not rigid


def test_a_frame_with_something_else_ends_tracks():
    images, head = shifted(20)
    images[10] = np.repeat(picture(seed=5)[..., None], 3, 2)
    tracks = follow_texture(images, head)
    spans = [set(tracks.frame[tracks.corner == corner].tolist()) for corner in range(len(tracks.vertex))]
    assert spans
    assert np.mean([{9, 11} <= span for span in spans]) < 0.1


def test_no_texture_gives_no_tracks():
    images, head = shifted()
    assert not len(follow_texture([np.full_like(image, 128) for image in images], head).vertex)


def test_corners_are_spread_over_the_head():
    images, head = shifted()
    tracks = follow_texture(images, head)
    cells = {tuple(np.floor(head.rest[vertex] / CELL).astype(int)) for vertex in tracks.vertex}
    assert len(cells) >= 6
