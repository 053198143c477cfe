"""The benchmark of the index of a large capture and the training on it, on a small one."""

import csv

import pytest

from evaluation.benchmarks.capture_index import WORKS, benchmark


@pytest.mark.slow
def test_every_quantity_is_measured(tmp_path):
    benchmark(tmp_path / "rows.csv", timesteps=20, cameras=3, iterations=2)
    with (tmp_path / "rows.csv").open(newline="") as stream:
        records = {record["quantity"]: float(record["value"]) for record in csv.DictReader(stream)}
    names = (*WORKS, "training")
    assert set(records) == {*names, *(f"{name}: memory" for name in names), "size of the index"}
    assert min(records.values()) > 0
