"""The benchmark of the metrics without networks, on two cameras."""

import csv

import pytest

from evaluation.benchmarks.image_metric_cost import PARTS, benchmark


@pytest.mark.slow
def test_the_parts_add_up_to_the_whole(tmp_path):
    benchmark(tmp_path / "cost.csv", cameras=2, timesteps=2)
    with (tmp_path / "cost.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    parts = {row["quantity"]: float(row["value"]) for row in rows if row["unit"] == "CPU ms per frame"}
    assert set(parts) == {"reading images", "posing and visibility", *PARTS} and min(parts.values()) > 0
    (total,) = (float(row["value"]) for row in rows if row["unit"] == "CPU s")
    assert total == pytest.approx(4e-3 * sum(parts.values()), rel=1e-4)
