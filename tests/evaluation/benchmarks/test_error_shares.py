"""Shares of the error: renderings that are off by the same everywhere have it in proportion to the pixels."""

import numpy as np
import pytest

from carigs.capture import Capture
from carigs.settings import Toy
from evaluation.benchmarks.error_shares import ErrorShares, measure
from evaluation.benchmarks.measurement.toy_frames import write_subject

SMALL = Toy(width=104, height=136, cameras=4, steps_per_sequence=2, supersampling=1, texture_size=128, hair_strands=200)
OFFSET = 51 / 255

pytestmark = pytest.mark.slow


class OffEverywhere:
    """Renders the captured frame with an offset."""

    def __init__(self, capture):
        self.frames = {(f.timestep, capture.camera(f).camera_from_world.tobytes()): f for f in capture.frames}
        self.capture = capture

    def render(self, timestep, level, camera):
        assert level == 0
        truth = self.capture.image(self.frames[timestep, camera.camera_from_world.tobytes()])
        return np.where(truth > 0.5, truth - OFFSET, truth + OFFSET)


@pytest.fixture(scope="module")
def capture(tmp_path_factory):
    folder = tmp_path_factory.mktemp("toy")
    write_subject(folder, SMALL)
    return Capture.load(folder / "capture.json")


def test_equal_errors_are_shared_by_area(capture):
    values = {(row.case, row.quantity): row for row in measure(capture, OffEverywhere(capture))}
    regions = {case for case, _ in values}
    assert {"full", "open mouth", "eyeballs", "lids", "lips", "brows", "hair over the scalp"} <= regions
    for region in regions:
        pixels, error = values[region, "share of the pixels"], values[region, "share of the squared error"]
        for of in ("value", "reference"):
            assert getattr(error, of) == pytest.approx(getattr(pixels, of), rel=1e-6)
            assert getattr(values[region, "PSNR"], of) == pytest.approx(-20 * np.log10(OFFSET), abs=1e-3)
    assert sum(values[region, "share of the pixels"].value for region in regions - {"full"}) < 1


def test_regions_do_not_overlap(capture):
    shares = ErrorShares(capture, None)
    for frame in capture.split("test"):
        assert np.sum(list(shares.regions(frame).values()), axis=0).max() == 1
