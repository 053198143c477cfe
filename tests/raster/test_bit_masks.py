"""Masks as bits against the same on arrays of booleans."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from carigs.raster import bit_masks as bits

SHAPES = st.tuples(st.integers(1, 150), st.integers(1, 40))


def some(shape, seed: int, share: float = 0.02) -> np.ndarray:
    return np.random.default_rng(seed).random(shape) < share


def as_bits(mask: np.ndarray) -> bits.Bits:
    return bits.above(mask.astype(np.uint8), 0)


@given(SHAPES, st.integers(0, 2**31))
def test_operators_are_those_of_booleans(shape, seed):
    one, other = some(shape, seed, 0.5), some(shape, seed + 1, 0.5)
    for found, expected in (
        (as_bits(one) & as_bits(other), one & other),
        (as_bits(one) | as_bits(other), one | other),
        (as_bits(one) - as_bits(other), one & ~other),
        (~as_bits(one), ~one),
    ):
        np.testing.assert_array_equal(found.image(), expected)
        assert bool(found) == expected.any()


@given(SHAPES, st.integers(0, 2**31), st.integers(0, 90))
def test_grown_as_opencv_dilates_and_nothing_beyond_the_border(shape, seed, radius):
    mask = some(shape, seed)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    grown = as_bits(mask).grown(radius)
    np.testing.assert_array_equal(grown.image(), cv2.dilate(mask.view(np.uint8), disc) > 0)
    assert not grown - as_bits(np.ones(shape, bool))


@given(SHAPES, st.integers(0, 2**31))
def test_reach_is_the_largest_distance(shape, seed):
    """Of the others' pixels to the nearest one: to two pixels and 4 %."""
    mask, other = some(shape, seed, 0.01), some(shape, seed + 1)
    reach = as_bits(mask).reach(as_bits(other))
    if not other[~mask].any():
        assert reach == 0
    elif not mask.any():
        assert reach >= max(shape)
    else:
        gaps = np.argwhere(other)[:, None] - np.argwhere(mask)[None]
        distance = np.sqrt((gaps**2).sum(axis=2)).min(axis=1).max()
        assert reach == pytest.approx(distance, abs=2.0, rel=0.04)


@given(SHAPES, st.integers(0, 2**31))
def test_pixels_are_chosen_by_their_faces(shape, seed):
    random = np.random.default_rng(seed)
    faces, face_image = random.random(5) < 0.5, random.integers(-1, 5, shape).astype(np.int32)
    expected = (face_image >= 0) & faces[face_image]
    np.testing.assert_array_equal(bits.chosen(face_image, faces).image(), expected)
