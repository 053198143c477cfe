"""The benchmark of steps that refine the tracking, on a small subject."""

import csv
from dataclasses import replace

import pytest

from carigs.settings import Toy
from evaluation.benchmarks.refined_step import SETTINGS, benchmark

SMALL = Toy(width=48, height=64, cameras=4, steps_per_sequence=1, supersampling=1, texture_size=128, hair_strands=200)


@pytest.mark.slow
def test_both_kinds_of_steps_are_timed(tmp_path):
    benchmark(tmp_path / "step.csv", SMALL, replace(SETTINGS, iterations=24), block=4)
    with (tmp_path / "step.csv").open(newline="") as stream:
        times, ratio = csv.DictReader(stream)
    refined, plain = float(times["value"]), float(times["reference"])
    assert refined > 0 and plain > 0
    rounding = 3 * 5e-6  # the file holds each of the three numbers with six digits
    assert float(ratio["value"]) == pytest.approx(refined / plain, rel=rounding)
