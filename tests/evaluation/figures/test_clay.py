"""Shaded renderings of meshes."""

import numpy as np
import pytest
from surfaces import sphere

from carigs.capture.images import read_rgb
from evaluation.figures.clay import SIZE, VIEWS, clay_sheet


def ink(file):
    """Share of the pixels that show a mesh, in each picture of a sheet of one row."""
    shown = (read_rgb(file) < 0.99).any(axis=2)
    shown[:24] = False  # the label
    return [part.mean() for part in np.split(shown, len(VIEWS), axis=1)]


def test_a_sphere_fills_a_disc_from_all_sides_and_vertices_without_triangles_do_not_shrink_it(tmp_path):
    vertices, faces = sphere(3)
    clay_sheet(tmp_path / "alone.png", {"a": vertices}, faces)
    far = np.concatenate([[[20.0, 0, 0]], vertices])
    clay_sheet(tmp_path / "far.png", {"a": far}, faces + 1)
    disc = np.pi / 4 / 3  # of the circumscribed ball of its bounding box
    assert ink(tmp_path / "alone.png") == pytest.approx([disc] * len(VIEWS), rel=0.06)
    assert np.array_equal(read_rgb(tmp_path / "alone.png"), read_rgb(tmp_path / "far.png"))
    assert read_rgb(tmp_path / "far.png").shape == (SIZE, len(VIEWS) * SIZE, 3)
