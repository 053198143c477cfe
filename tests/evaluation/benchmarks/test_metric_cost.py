"""The benchmark of the metrics that need networks, on few frames."""

import csv

import pytest

from evaluation.benchmarks.metric_cost import RUNS, benchmark


@pytest.mark.slow
def test_every_run_is_measured_and_the_cache_saves_time(tmp_path):
    benchmark(tmp_path / "rows.csv", frames=16)
    with (tmp_path / "rows.csv").open(newline="") as stream:
        records = {record["quantity"]: float(record["value"]) for record in csv.DictReader(stream)}
    assert set(records) == {*RUNS, *(f"{name}: memory" for name in RUNS)}
    assert min(records.values()) > 0
    assert records["all in the cache"] < records["all images"] / 2
