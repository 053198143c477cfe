"""Of the people in a coarse matte, the one whose face is known stays."""

import cv2
import numpy as np
import pytest

from carigs.matting.one_person import of_one_person

SIDE = 128


def people(*places, soft=3):
    """Heads, 24 pixels wide, above shoulders three times as wide."""
    matte = np.zeros((SIDE, SIDE), np.float32)
    for x, y in places:
        cv2.ellipse(matte, (x, y), (12, 16), 0, 0, 360, 1.0, -1)
        cv2.rectangle(matte, (x - 6, y), (x + 6, y + 30), 1.0, -1)
        cv2.ellipse(matte, (x, SIDE), (36, SIDE - y - 22), 0, 180, 360, 1.0, -1)
    return cv2.GaussianBlur(matte, (0, 0), soft)


def face(x, y):
    return np.array([x - 10.0, y - 12, x + 10, y + 15])


def test_a_person_alone_keeps_the_matte():
    alone = people((60, 50))
    np.testing.assert_array_equal(of_one_person(alone, face(60, 50)), alone)
    strands = alone.copy()
    strands[10:14, 58:62] = 0.4  # nobody's yet, and perhaps hair
    np.testing.assert_array_equal(of_one_person(strands, face(60, 50)), strands)


@pytest.mark.parametrize(("own", "other"), [((36, 60), (96, 60)), ((36, 60), (96, 40)), ((96, 45), (36, 70))])
def test_the_head_of_another_person_is_left_out_although_shoulders_touch(own, other):
    both, alone = people(own, other), people(own)
    found = of_one_person(both, face(*own))
    chin = own[1] + 15
    assert np.abs(found - alone)[: chin - 4, abs(np.arange(SIDE) - own[0]) < 20].max() < 0.05
    assert found[: chin - 4, abs(np.arange(SIDE) - other[0]) < 14].max() < 0.1 < 0.9 < both[other[1], other[0]]


def test_a_person_who_stands_apart_is_left_out_wholly():
    both = people((24, 50), (104, 50))
    both[:, 60:68] = 0
    found = of_one_person(both, face(24, 50))
    assert found[:, 70:].max() < 0.1
    np.testing.assert_array_equal(found[:, :60], both[:, :60])


@pytest.mark.parametrize("box", [np.full(4, np.nan), np.array([2.0, 2, 8, 8]), np.array([-50.0, -50, -40, -40])])
def test_a_face_that_is_unknown_or_where_nobody_is_changes_nothing(box):
    both = people((36, 60), (96, 60))
    np.testing.assert_array_equal(of_one_person(both, box), both)
