"""Pixels near the outline of the mesh: against circles, and in the examples of a training."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from miniature import write_ball

from carigs.capture import Camera, look_at, read_dataset
from carigs.exaggeration.gamma_path import straight_path
from carigs.head import neutral
from carigs.raster import compute_visibility
from carigs.settings import Train
from carigs.splat.training.outlines import NEAR, near_outline
from carigs.splat.training.subject import prepare_subject

BALL = trimesh.creation.icosphere(subdivisions=4, radius=0.1)


@settings(max_examples=20, deadline=None)
@given(st.floats(40, 280), st.floats(0.002, 0.02))
def test_pixels_near_the_outline_of_a_ball_are_a_ring(focal, distance):
    """The outline of a ball, whose middle is 1 m away, is a circle; its distance is measured at that depth."""
    camera = Camera(look_at(np.array([0, 0, 1.0]), np.zeros(3)), focal, focal, 40, 32, 80, 64)
    near = near_outline(compute_visibility(BALL.vertices, BALL.faces, camera), distance)
    y, x = np.mgrid[:64, :80] + 0.5
    outline = focal * 0.1 / np.sqrt(1 - 0.1**2)
    beside = np.abs(np.hypot(x - 40, y - 32) - outline)
    radius = max(focal * distance, 1.0)
    # Distances count from centre to centre of pixels, and an icosphere lies inside its ball.
    assert not near[beside > radius * 1.05 + 1.2].any()
    assert near[beside < radius * 0.95 - 1.7].all()


def test_nothing_is_near_where_no_mesh_is_or_nothing_else():
    for eye, target in (([0, 0, 1.0], [0, 0, 2.0]), ([0, 0, 0.11], [0, 0, 0])):
        camera = Camera(look_at(np.array(eye), np.array(target, float)), 300, 300, 40, 32, 80, 64)
        assert not near_outline(compute_visibility(BALL.vertices, BALL.faces, camera)).any()


@pytest.mark.parametrize("weight", [1.0, 2.0, 3.0])
def test_factors_of_real_frames(tmp_path, weight):
    write_ball(tmp_path)
    capture = read_dataset(tmp_path, tmp_path / "head_model.npz")
    rest = neutral(capture.model, capture.parameters(0))
    path = straight_path(rest, capture.model.faces, rest * [0.3, 0, 0], 0.25)
    subject = prepare_subject(capture, path, Train(gtstar_probability=0, outline_weight=weight, mouth_surfels=0))
    example = subject.supervision.example(False, 0)
    if weight == 1:
        assert example.emphasis is None
        return
    for level, factor in ((0.0, weight), (0.25, weight**2)):
        seen = compute_visibility(
            subject.sequence.posed(example.timestep, level), subject.sequence.rig.faces, example.camera
        )
        outlines = subject.supervision.outlines
        for _ in range(2):
            found = outlines.emphasis(example.timestep, 0, example.camera, level)
            np.testing.assert_array_equal(found, np.where(near_outline(seen, NEAR), np.float32(factor), np.float32(1)))
        assert {1.0, factor} == set(np.unique(found))
        assert level or (found == example.emphasis).all()
