"""The benchmark of the exaggeration measures what its rows say."""

import csv

import pytest
import trimesh

from carigs.errors import InputError
from evaluation.benchmarks.measurements import Measurement, write_measurements
from evaluation.benchmarks.surface import benchmark, head_rows, sphere_rows


def test_the_sphere_law_is_met_at_second_order():
    rows = [row for row in sphere_rows(range(2, 4), repeats=1) if "error" in row.quantity]
    assert rows[0].reference is None
    assert rows[1].reference == rows[0].value
    assert 3.4 < rows[0].value / rows[1].value < 4.6


def test_more_nodes_are_nearer_and_bounds_lie_above_the_truth():
    mesh = trimesh.creation.torus(1.0, 0.4, major_sections=24, minor_sections=12)
    rows = list(head_rows("torus", mesh.vertices, mesh.faces, repeats=1))
    errors = [row.value for row in rows if row.quantity.startswith("largest error of a path")]
    assert errors == sorted(errors, reverse=True)
    assert errors[-1] < 0.01 * errors[0]
    bounds = [row for row in rows if row.quantity.startswith("bound")]
    assert len(bounds) == 4
    assert all(row.value >= row.reference > 0 for row in bounds)
    assert all(row.value > 0 for row in rows if row.unit == "s")


def test_rows_as_csv(tmp_path):
    write_measurements(
        tmp_path / "rows.csv", [Measurement("a, b", "time", "s", 1 / 3), Measurement("c", "d", "1", 2, 4)]
    )
    with (tmp_path / "rows.csv").open(newline="") as stream:
        assert list(csv.reader(stream)) == [
            ["case", "quantity", "unit", "value", "reference"],
            ["a, b", "time", "s", "0.333333", ""],
            ["c", "d", "1", "2", "4"],
        ]


def test_a_missing_mesh_is_named_before_work_starts(tmp_path):
    with pytest.raises(InputError, match=r"none\.obj: no such mesh"):
        benchmark(tmp_path / "rows.csv", [tmp_path / "none.obj"])
    assert not list(tmp_path.iterdir())
