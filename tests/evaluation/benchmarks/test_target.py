"""The benchmark of GT* targets, on a tiny procedural subject."""

import csv
import re

import numpy as np
import pytest

from carigs.capture.images import read_rgb
from carigs.settings import Toy
from evaluation.benchmarks.relighting import DIRECTIONS
from evaluation.benchmarks.target import OPTIONS, benchmark

TINY = Toy(width=48, height=64, cameras=2, steps_per_sequence=1, supersampling=1, texture_size=128, hair_strands=50)


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:levels outside")  # relighting is measured beyond gamma_f, too
def test_every_option_is_measured_and_drawn(tmp_path):
    benchmark(tmp_path / "target.csv", toy=TINY, repeats=1)
    with (tmp_path / "target.csv").open(newline="") as stream:
        records = list(csv.DictReader(stream))
    cases = {record["case"] for record in records}
    assert len(cases) == 1 + len(OPTIONS) + 4 + len(DIRECTIONS)
    values = {(record["case"], record["quantity"]): float(record["value"]) for record in records}
    assert len(values) == len(records)
    assert np.isfinite(list(values.values())).all() and min(values.values()) >= 0
    for case in cases:
        if re.fullmatch(r"\w+, \dx\d", case):
            assert values[case, "visibility, warp and masks"] > 0
            assert 0 < values[case, "mean absolute error"] < values[case, "99th percentile of the error"] < 1
    assert read_rgb(tmp_path / "target.png").std() > 0
