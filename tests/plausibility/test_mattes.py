"""Exchanged mattes: a matte of another timestep is noticed, an outline of another width is not."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from carigs.capture import Camera, Capture, Frame
from carigs.plausibility.mattes import ForegroundBits, exchanged_mattes

SIZE = 128
CAMERA = Camera(np.eye(4), SIZE, SIZE, 200.0, 200.0, SIZE / 2, SIZE / 2)
FRAMES = tuple(Frame(t, 0, "", "train", f"{t}.png", f"{t}_mask.png", "", 0) for t in range(5))
CAPTURE = Capture(Path("capture"), Path("head.npz"), FRAMES, (CAMERA,), 1.0)


def disc(timestep: int, margin: int = 0) -> np.ndarray:
    """A head that moves by 4 pixels from timestep to timestep, its outline moved outward by a margin."""
    mask = np.zeros((SIZE, SIZE), np.uint8)
    return cv2.circle(mask, (50 + 4 * timestep, 64), 40 + margin, 1, -1) > 0


def findings(shown: list[int], image_margin: int = 0) -> list[str]:
    """Mattes that are noticed where images show the given timesteps."""
    images = [disc(t, image_margin) for t in shown]
    pairs = zip(FRAMES, images, strict=True)
    known = {frame: ForegroundBits(np.packbits(image), np.packbits(disc(frame.timestep))) for frame, image in pairs}
    return [finding.file.name for finding in exchanged_mattes(CAPTURE, known)]


@pytest.mark.parametrize("margin", [-1, 0, 1])
def test_images_of_other_timesteps_are_noticed(margin):
    assert findings([0, 3, 2, 1, 4], margin) == ["1_mask.png", "3_mask.png"]


@pytest.mark.parametrize("margin", [-4, -2, -1, 0, 1, 2, 4])
def test_outlines_of_another_width_are_no_exchange(margin):
    assert findings([0, 1, 2, 3, 4], margin) == []


def test_a_difference_on_one_side_counts_where_it_is_unusual():
    images = [disc(t, 3 if t == 1 else 0) for t in range(5)]
    mattes = [disc(t if t != 3 else 1, 3 if t == 3 else 0) for t in range(5)]
    pairs = zip(FRAMES, images, mattes, strict=True)
    known = {frame: ForegroundBits(np.packbits(image), np.packbits(matte)) for frame, image, matte in pairs}
    assert "1_mask.png" in [finding.file.name for finding in exchanged_mattes(CAPTURE, known)]
