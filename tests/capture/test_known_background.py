"""Mattes that are made anew from an image before a known background."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from discs import RADIUS, SIZE, before, disc, in_bytes

from carigs.capture.corrections.known_background import outline_reach, remake_matte

COLOUR = 0.7, 0.5, 0.35
WRONG = {
    "sound": disc(),
    "grown": disc(RADIUS + 3),
    "shrunk": disc(RADIUS - 3),
    "blurred": cv2.GaussianBlur(disc(), (0, 0), 1.5),
    "with a hole": disc() - disc(2),
}


@pytest.mark.parametrize("background", [0.0, 1.0])
@pytest.mark.parametrize("kind", WRONG)
def test_the_matte_is_that_of_the_image_whichever_is_stated(kind, background):
    image = in_bytes(before(background, COLOUR, disc()))
    remade = remake_matte(image, in_bytes(WRONG[kind]), background)
    np.testing.assert_allclose(remade.alpha, disc(), atol=0.015)


def test_shades_of_the_foreground_do_not_make_it_transparent():
    """One half is dark and the other bright: the colours nearby count, not the mean of all."""
    colours = np.full((SIZE, SIZE, 3), COLOUR) * np.where(np.arange(SIZE) < SIZE // 2, 1.0, 0.3)[:, None]
    remade = remake_matte(in_bytes(before(1.0, colours, disc())), in_bytes(disc(RADIUS + 2)), 1.0)
    at_the_border = np.abs(np.arange(SIZE) - SIZE // 2) < 12
    assert np.abs(remade.alpha - disc())[:, ~at_the_border].max() < 0.05


def test_a_foreground_of_the_colour_of_the_background_keeps_its_matte():
    stated = in_bytes(disc(RADIUS + 2))
    remade = remake_matte(in_bytes(before(1.0, (0.95, 0.95, 0.95), disc())), stated, 1.0)
    assert not remade.known.any()
    np.testing.assert_array_equal(in_bytes(remade.alpha), stated)


def test_an_empty_matte_stays_empty():
    empty = np.zeros((SIZE, SIZE), np.uint8)
    remade = remake_matte(in_bytes(before(1.0, COLOUR, disc())), empty, 1.0)
    assert not remade.known.any() and not remade.alpha.any()


def test_nothing_changes_farther_from_the_outline_than_the_reach():
    """A bright spot deep inside, and a dark one far outside."""
    image = before(1.0, COLOUR, disc())
    image[60, 60], image[5, 5] = 1.0, 0.0
    remade = remake_matte(in_bytes(image), in_bytes(disc()), 1.0)
    assert remade.alpha[60, 60] == 1 and remade.alpha[5, 5] == 0


def test_the_reach_is_a_share_of_the_diagonal_and_some_pixels_at_least():
    assert outline_reach((10, 10)) == 6
    assert outline_reach((2400, 3200)) == 2 * outline_reach((1200, 1600)) == 50
