"""Components, boundary and volume of known surfaces."""

import numpy as np
import pytest
from surfaces import cap, sphere

from carigs.mesh.triangle_mesh import boundary_vertices, components, signed_volume


def test_components_and_boundary():
    vertices, faces = sphere(1)
    both = np.vstack([faces, faces + len(vertices)])
    labels = components(both, 2 * len(vertices))
    assert set(labels[: len(vertices)]) == {0}
    assert set(labels[len(vertices) :]) == {1}
    assert not boundary_vertices(both, 2 * len(vertices)).any()
    rim, faces = cap(3)
    on_rim = boundary_vertices(faces, len(rim))
    assert rim[on_rim, 2].max() < rim[~on_rim, 2].min() + 0.2
    assert on_rim.any()


def test_volume_of_a_ball_and_of_one_inside_out():
    vertices, faces = sphere(4, 2.0)
    assert signed_volume(vertices + 7, faces) == pytest.approx(4 / 3 * np.pi * 8, rel=5e-3)
    assert signed_volume(vertices, faces[:, ::-1]) == pytest.approx(-signed_volume(vertices, faces))
