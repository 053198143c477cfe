"""Numbers of landmarks."""

import numpy as np
from shared_data import DATA, needs_data

from carigs.detection import mesh_indices as indices


def test_mirroring_twice_is_nothing():
    mirrored = np.array(indices.MIRRORED)
    assert (mirrored[mirrored] == np.arange(indices.COUNT)).all()


def test_left_and_right_are_mirror_images():
    for left, right in (
        (indices.LEFT_EYE_REGION, indices.RIGHT_EYE_REGION),
        (indices.LEFT_BROW, indices.RIGHT_BROW),
        (indices.LEFT_EYE, indices.RIGHT_EYE),
    ):
        assert tuple(indices.MIRRORED[i] for i in left) == right
    for part in (indices.LIPS, indices.NOSE, indices.FACE_OUTLINE, indices.JAW_LINE):
        assert {indices.MIRRORED[i] for i in part} == set(part) and len(set(part)) == len(part)


@needs_data
def test_the_canonical_face_agrees():
    lines = (DATA / "meshes/mediapipe_canonical_face_model.obj").read_text().splitlines()
    points = np.array([line.split()[1:4] for line in lines if line.startswith("v ")], float)
    mirrored = points[list(indices.MIRRORED[: len(points)])] * (-1, 1, 1)
    np.testing.assert_allclose(mirrored, points, atol=0.01)
    for upper, lower in (*indices.LIP_GAPS, *indices.LEFT_LID_GAPS, *indices.RIGHT_LID_GAPS):
        assert points[upper, 1] >= points[lower, 1]
    assert points[list(indices.LEFT_EYE), 0].max() < 0 < points[list(indices.RIGHT_EYE), 0].min()
