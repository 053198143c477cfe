"""Bit masks against the same operations on boolean arrays."""

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from carigs.raster.bit_masks import BitMask, greater, pixels_of_faces

SHAPES = st.tuples(st.integers(1, 150), st.integers(1, 40))


def random_mask(shape, seed: int, share: float = 0.02) -> np.ndarray:
    return np.random.default_rng(seed).random(shape) < share


def as_bits(mask: np.ndarray) -> BitMask:
    return greater(mask.astype(np.uint8), 0)


@given(SHAPES, st.integers(0, 2**31))
def test_operators_match_boolean_arrays(shape, seed):
    one, other = random_mask(shape, seed, 0.5), random_mask(shape, seed + 1, 0.5)
    for result, expected in (
        (as_bits(one) & as_bits(other), one & other),
        (as_bits(one) | as_bits(other), one | other),
        (as_bits(one) - as_bits(other), one & ~other),
        (~as_bits(one), ~one),
    ):
        np.testing.assert_array_equal(result.to_array(), expected)
        assert bool(result) == expected.any()


@given(SHAPES, st.integers(0, 2**31), st.integers(0, 90))
def test_dilation_matches_opencv_and_stays_inside_the_image(shape, seed, radius):
    mask = random_mask(shape, seed)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1))
    dilated = as_bits(mask).dilated(radius)
    np.testing.assert_array_equal(dilated.to_array(), cv2.dilate(mask.view(np.uint8), disc) > 0)
    assert not dilated - as_bits(np.ones(shape, bool))


@given(SHAPES, st.integers(0, 2**31))
def test_covering_radius_is_the_largest_distance(shape, seed):
    """Of the other mask's pixels to the nearest pixel: to two pixels and 4 %."""
    mask, other = random_mask(shape, seed, 0.01), random_mask(shape, seed + 1)
    radius = as_bits(mask).covering_radius(as_bits(other))
    if not other[~mask].any():
        assert radius == 0
    elif not mask.any():
        assert radius >= max(shape)
    else:
        offsets = np.argwhere(other)[:, None] - np.argwhere(mask)[None]
        distance = np.sqrt((offsets**2).sum(axis=2)).min(axis=1).max()
        assert radius == pytest.approx(distance, abs=2.0, rel=0.04)


@given(SHAPES, st.integers(0, 2**31))
def test_pixels_are_selected_by_their_faces(shape, seed):
    random = np.random.default_rng(seed)
    faces, face_image = random.random(5) < 0.5, random.integers(-1, 5, shape).astype(np.int32)
    expected = (face_image >= 0) & faces[face_image]
    np.testing.assert_array_equal(pixels_of_faces(face_image, faces).to_array(), expected)
