"""The benchmark of wrong tracking, on a small subject: refinement brings heads nearer to the true ones."""

import numpy as np
import pytest

from carigs.head import HeadParameters
from carigs.settings import RefineTracking, Toy
from evaluation.benchmarks.tracking_errors import DEFAULT, JAW_RADIANS, METRES, RADIANS, Case, disturbed, measure

SMALL = Toy(width=104, height=136, cameras=6, steps_per_sequence=1, supersampling=1, texture_size=128, hair_strands=200)


def test_errors_have_the_given_sizes():
    rng, exact = np.random.default_rng(1), HeadParameters()
    heads = [disturbed(exact, rng) for _ in range(2000)]
    for values, size in (
        ([h.translation for h in heads], METRES),
        ([h.rotation for h in heads], RADIANS),
        ([h.joints[1] for h in heads], JAW_RADIANS),
    ):
        assert np.std(values) == pytest.approx(size, rel=0.05)
    assert not any(h.joints[[0, 2, 3]].any() for h in heads)


@pytest.mark.slow
def test_refinement_mends_wrong_tracking(tmp_path):
    cases = [
        Case("exact", False, RefineTracking()),
        Case("wrong", True, RefineTracking()),
        Case("mended", True, DEFAULT),
    ]
    rows = {(row.case, row.quantity): row.value for row in measure(tmp_path, SMALL, 200, cases)}
    assert rows["exact", "distance"] == 0
    assert 0 < rows["mended", "distance"] < rows["wrong", "distance"]
    assert rows["wrong", "PSNR of training frames"] < rows["mended", "PSNR of training frames"]
    assert rows["wrong", "PSNR of held-out frames"] < rows["exact", "PSNR of held-out frames"]
