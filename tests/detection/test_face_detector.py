"""The detectors' boxes."""

import numpy as np
import pytest

from carigs.detection.face_detector import FULL_RANGE, SHORT_RANGE, anchors, decoded, overlaps, suppressed


@pytest.mark.parametrize(("kind", "count"), [(SHORT_RANGE, 896), (FULL_RANGE, 2304)])
def test_there_is_a_cell_for_each_box_of_the_network(kind, count):
    centres = anchors(kind)
    assert centres.shape == (count, 2) and centres.min() > 0 and centres.max() < 1
    np.testing.assert_allclose(centres.mean(axis=0), 0.5)
    cells, boxes = kind.grids[0]
    np.testing.assert_allclose(centres[boxes] - centres[0], (1 / cells, 0), atol=1e-12)  # x first


def test_values_become_a_box_and_points_around_the_cell():
    values = np.array([[3, -2, 10, 20, *range(12)]], float)
    points = decoded(values, np.array([[0.5, 0.25]]), 128)[0]
    np.testing.assert_allclose(points[:2], [[64 + 3 - 5, 32 - 2 - 10], [64 + 3 + 5, 32 - 2 + 10]])
    np.testing.assert_allclose(points[2:], np.add(np.arange(12).reshape(6, 2), (64, 32)))


def test_boxes_of_one_face_become_their_weighted_mean():
    near, far = np.array([[0, 0], [10, 10.0]]), np.array([[50, 50], [60, 60.0]])
    corners = np.stack([far, near, near + 1])
    faces, scores = suppressed(corners, np.array([0.6, 0.9, 0.3]))
    np.testing.assert_allclose(faces, [near + 0.25, far])
    np.testing.assert_allclose(scores, [0.9, 0.6])


def test_there_may_be_no_box_and_boxes_without_area():
    faces, scores = suppressed(np.zeros((0, 8, 2)), np.zeros(0))
    assert faces.shape == (0, 8, 2) and scores.shape == (0,)
    faces, _ = suppressed(np.zeros((3, 8, 2)), np.ones(3))
    assert len(faces) == 3


def test_the_overlap_is_the_shared_part_of_both():
    box = np.array([0, 0, 4, 4.0])
    others = np.array([[0, 0, 4, 4], [2, 0, 6, 4], [4, 0, 8, 4], [9, 9, 1, 1.0]])
    np.testing.assert_allclose(overlaps(box, others), [1, 1 / 3, 0, 0])
