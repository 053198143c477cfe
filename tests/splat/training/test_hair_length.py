"""Length of the hair from mattes: a ball with a shell of known thickness."""

from dataclasses import replace

import numpy as np
import pytest
from miniature import write_ball
from surfaces import sphere

from carigs.capture import Camera, look_at, read_dataset
from carigs.capture.images import write_png
from carigs.raster import rasterize_mesh
from carigs.settings import Train
from carigs.splat.training.hair_length import QUANTILE, hair_reach, measured_hair_length

RADIUS, DISTANCE, FOCAL = 0.1, 1.0, 1500.0
PIXEL = DISTANCE / FOCAL
SIDE = Camera(look_at(np.array([0, 0, DISTANCE]), np.zeros(3)), FOCAL, FOCAL, 300.0, 300.0, 600, 600)


@pytest.fixture(scope="module")
def ball():
    """The ball, and its upper half."""
    vertices, faces = sphere(5, RADIUS)
    return vertices, faces, vertices[faces].mean(axis=1)[:, 1] > 0


def matte_of(vertices, faces, camera):
    return (rasterize_mesh(vertices, faces, camera).face >= 0).astype(np.float32)


@pytest.mark.parametrize("thickness", [0.0, 0.005, 0.02, 0.06])
def test_a_shell_around_a_ball_is_measured_within_a_pixel(ball, thickness):
    """A sphere of radius r at distance d has an outline of radius f r / sqrt(d^2 - r^2), at the depth d - r^2 / d."""
    vertices, faces, hair = ball
    reach = hair_reach(vertices, faces, hair, SIDE, matte_of(vertices * (1 + thickness / RADIUS), faces, SIDE))
    outer, inner = (r / np.sqrt(DISTANCE**2 - r**2) for r in (RADIUS + thickness, RADIUS))
    expected = (outer - inner) * (DISTANCE - RADIUS**2 / DISTANCE)
    assert np.quantile(reach, QUANTILE) == pytest.approx(expected, abs=1.5 * PIXEL)
    assert np.median(reach) == pytest.approx(expected, abs=2 * PIXEL)


def test_only_the_outline_beside_hair_counts(ball):
    """A shell below the ball does not reach beyond hair on its upper half."""
    vertices, faces, hair = ball
    lower = matte_of(vertices * 1.3, faces, SIDE)
    lower[:300] = matte_of(vertices, faces, SIDE)[:300]
    assert hair_reach(vertices, faces, hair, SIDE, lower).max() < 3 * PIXEL
    assert hair_reach(vertices, faces, ~hair, SIDE, lower).max() > 0.025
    assert len(hair_reach(vertices, faces, np.zeros(len(faces), bool), SIDE, lower)) == 0


def test_a_mesh_outside_the_image_has_no_reach(ball):
    vertices, faces, hair = ball
    assert len(hair_reach(vertices + np.array([9, 0, 0]), faces, hair, SIDE, np.ones((600, 600), np.float32))) == 0


def test_the_length_of_a_capture(tmp_path):
    write_ball(tmp_path)
    subject = read_dataset(tmp_path, tmp_path / "head_model.npz")
    scalp = subject.model.face_region("scalp")
    pixel = 1.0 / 150
    assert measured_hair_length(subject, scalp) < pixel  # its mattes end with the mesh
    assert measured_hair_length(subject, np.zeros_like(scalp)) == Train().hair_length
    held_out = replace(subject, frames=subject.split("test"))
    assert measured_hair_length(held_out, scalp) == Train().hair_length
    full = np.ones((48, 40), np.float32)
    framed = np.pad(full[1:-1, 1:-1], 1)
    for matte, expected in ((full, Train().hair_length), (framed, 15 * pixel)):  # a full matte has no edge
        for frame in subject.split("train"):
            write_png(tmp_path / frame.mask, matte)
        assert measured_hair_length(subject, scalp) == pytest.approx(expected, abs=4 * pixel if matte is framed else 0)
