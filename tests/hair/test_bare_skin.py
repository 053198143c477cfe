"""Where can no hair be?"""

import numpy as np
from hair.hairy_ball import RADIUS, ball

from carigs.hair.bare_skin import CELL, NEAR_SKIN, SpaceAboveSkin


def test_it_is_the_shell_around_the_bare_part_of_a_ball():
    vertices, faces = ball()
    height = vertices[faces].mean(axis=1)[:, 1]
    space = SpaceAboveSkin(vertices, faces, height < 0)
    rng = np.random.default_rng(0)
    direction = rng.standard_normal((20000, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    points = direction * RADIUS * rng.uniform(0.5, 1.5, (len(direction), 1))
    off, edge = np.abs(np.linalg.norm(points, axis=1) - RADIUS), np.abs(vertices[faces].max() - RADIUS) + 2 * CELL
    sagitta = RADIUS - np.linalg.norm(vertices[faces].mean(axis=1), axis=1).min()  # triangles are flat
    inside = (off < NEAR_SKIN - edge - sagitta) & (points[:, 1] < -2 * RADIUS / 10)
    outside = (off > NEAR_SKIN + edge + sagitta) | (points[:, 1] > 2 * RADIUS / 10)
    found = space.contains(points)
    assert inside.sum() > 100 and outside.sum() > 1000
    assert found[inside].all() and not found[outside].any()
    assert not space.contains(np.full((1, 3), 1e6)).any()


def test_cells_that_were_asked_for_are_those_of_the_grid():
    vertices, faces = ball()
    vertices = 0.4 * vertices  # cells have a fixed size
    bare = vertices[faces].mean(axis=1)[:, 1] < 0
    asked, whole = SpaceAboveSkin(vertices, faces, bare), SpaceAboveSkin(vertices, faces, bare).grid()
    cells = np.argwhere(np.ones(whole.shape, bool))[::7]
    found = asked.contains(asked.low + (cells + 0.5) * CELL)
    assert found.any() and not found.all()
    np.testing.assert_array_equal(found, whole[tuple(cells.T)])
    np.testing.assert_array_equal(asked.grid(), whole)


def test_a_head_without_bare_skin_has_no_such_space():
    vertices, faces = ball()
    assert not SpaceAboveSkin(vertices, faces, np.zeros(len(faces), bool)).contains(vertices).any()
