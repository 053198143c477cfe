"""Errors of mattes near the outline: of a disc, and of a small person whose coarse matte is known."""

import numpy as np
import pytest

from evaluation.benchmarks.footage.matte_errors import BAND, band, measure
from evaluation.benchmarks.footage.motion import Talk
from evaluation.benchmarks.footage.oracle_recordings import filmed_toy, toy_subject

COUNT = 4


def test_the_band_of_a_disc_is_a_ring():
    y, x = np.mgrid[:101, :101] - 50
    radius = np.hypot(x, y)
    near = band((radius <= 25).astype(float))
    assert near[np.abs(radius - 25) < BAND - 1].all() and not near[np.abs(radius - 25) > BAND + 1].any()


@pytest.fixture(scope="module")
def filmed():
    subject = toy_subject(supersampling=1, texture_size=128, hair_strands=100)
    return filmed_toy(subject, "talk", Talk(seconds=1, fps=COUNT), side=96)


def test_the_true_matte_as_the_coarse_one_has_no_error_of_its_own(filmed):
    """The network is asked twice for the coarse matte of each frame, and once more here."""
    mattes = {
        frame.tobytes(): np.float32(matte) / 255
        for frame, matte in zip(filmed.frames[0], filmed.mattes[0], strict=True)
    }
    rows = {row.quantity: row.value for row in measure("toy", filmed, lambda image: mattes[image.tobytes()])}
    assert rows["error of the coarse mattes"] < 1e-6
    assert rows["error near the outline"] < 0.06


def test_no_person_at_all_is_as_wrong_as_the_share_of_the_person(filmed):
    rows = {row.quantity: row.value for row in measure("toy", filmed, lambda image: np.zeros((256, 256), np.float32))}
    share = np.mean([(matte / 255)[band(matte / 255)].mean() for matte in filmed.mattes[0]])
    assert rows["error of the coarse mattes"] == pytest.approx(share)
    assert rows["error near the outline"] > 0.3 * share
