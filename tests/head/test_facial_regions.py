"""Triangles of eyes and brows."""

from dataclasses import replace

import numpy as np
from miniature import ball_model

from carigs.head.facial_regions import eye_and_brow_faces


def test_eyeballs_and_brows_are_found_by_their_regions():
    ball = ball_model()
    assert not eye_and_brow_faces(ball, ball.v_template).any()  # a model without these regions
    x, y, z = ball.v_template.T
    eyeballs = {"left_eyeball": np.flatnonzero(x > 0.08), "right_eyeball": np.flatnonzero(x < -0.08)}
    head = replace(ball, regions={**ball.regions, **eyeballs, "brows": np.flatnonzero((y > 0.05) & (z > 0.05))})
    found = eye_and_brow_faces(head, head.v_template)
    assert (found == head.face_region("left_eyeball", "right_eyeball", "brows")).all()
    assert found.any()
    assert not found.all()
