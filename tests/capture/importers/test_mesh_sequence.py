"""A sequence of meshes with polygons: the same triangles in all frames, however the polygons bend."""

import numpy as np
import pytest

from carigs.capture.importers.mesh_sequence import read_mesh_sequence
from carigs.errors import InputError
from carigs.head import pose_frames

RING = np.array([[0, 0], [2, 2], [0, 3], [-2, 2]], float)


def prism(notch):
    """A box on a quadrilateral whose first corner moves inwards: beyond 2 it is concave."""
    outline = RING + np.array([[0, notch], [0, 0], [0, 0], [0, 0]])
    return np.concatenate([np.concatenate([outline, np.full((4, 1), z)], axis=1) for z in (0.0, 1.0)])


POLYGONS = [[3, 2, 1, 0], [4, 5, 6, 7], *([i, (i + 1) % 4, 4 + (i + 1) % 4, 4 + i] for i in range(4))]


def write(file, vertices, polygons=POLYGONS):
    rows = ["v " + " ".join(map(repr, vertex)) for vertex in vertices.tolist()]
    file.write_text("\n".join([*rows, *("f " + " ".join(str(i + 1) for i in p) for p in polygons), ""]))


@pytest.mark.parametrize("notches", [(0.0, 2.5), (2.5, 0.0), (2.5, 2.6)])
def test_polygons_may_become_concave(notches, tmp_path):
    for t, notch in enumerate(notches):
        write(tmp_path / f"frame_{t}.obj", prism(notch))
    track = read_mesh_sequence(tmp_path)
    assert track.model.faces.shape == (12, 3)
    posed = pose_frames(track.model, list(track.parameters.values()))
    np.testing.assert_allclose(posed, [prism(notch) for notch in notches], atol=1e-5)


def test_other_polygons_are_refused_even_if_they_have_as_many_corners(tmp_path):
    write(tmp_path / "frame_0.obj", prism(0.0))
    write(tmp_path / "frame_1.obj", prism(0.0), [[2, 1, 0, 3], *POLYGONS[1:]])
    with pytest.raises(InputError, match=r"frame_1\.obj: has other faces than the first mesh"):
        read_mesh_sequence(tmp_path)
