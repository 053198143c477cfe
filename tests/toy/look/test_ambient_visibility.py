"""Ambient visibility of a ball, alone and inside a shell."""

from __future__ import annotations

import numpy as np
import trimesh

from carigs.toy.look.ambient_visibility import ambient_visibility


def test_ambient_visibility_is_one_on_a_ball_and_zero_inside_a_shell() -> None:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    assert ambient_visibility(ball.vertices, np.asarray(ball.faces)).min() > 0.97
    shell = trimesh.creation.icosphere(subdivisions=3, radius=0.11)
    both = np.concatenate([ball.faces, shell.faces + len(ball.vertices)])
    free = ambient_visibility(np.concatenate([ball.vertices, shell.vertices]), both)
    assert free[: len(ball.vertices)].max() < 0.02 and free[len(ball.vertices) :].min() > 0.97
