"""The benchmark of the exaggeration: errors converge, solvers agree, files are complete."""

import csv

import numpy as np
import pytest
import trimesh

from carigs.errors import InputError
from carigs.exaggeration import Exaggerator
from carigs.settings import Exaggerate
from evaluation.benchmarks.exaggeration import surface_solvers
from evaluation.benchmarks.exaggeration.curvature_accuracy import measure_curvature
from evaluation.benchmarks.exaggeration.surface_accuracy import (
    measure_blend_bounds,
    measure_paths,
    measure_sphere_law,
)
from evaluation.benchmarks.measurement.plots import plot_surface
from evaluation.benchmarks.measurement.timing import Measurement
from evaluation.benchmarks.surface import measure_set_up, read_heads
from evaluation.tables.csv_files import stream_csv

TORUS = trimesh.creation.torus(1.0, 0.4, major_sections=24, minor_sections=12)
MESH = np.asarray(TORUS.vertices), np.asarray(TORUS.faces)


def test_the_sphere_law_is_met_at_second_order():
    first, second = measure_sphere_law(range(2, 4))
    assert first.reference is None
    assert second.reference == first.value
    assert 3.4 < first.value / second.value < 4.6


def test_curvature_of_smooth_surfaces_comes_nearer():
    """The angle defect converges where vertices lie evenly, and over barycentric cells it does not."""
    records = {(row.case.split(",")[0], row.quantity): row for row in measure_curvature(range(2, 4))}
    voronoi = records["torus", "error of K: angle defect, mixed Voronoi"]
    assert voronoi.value < voronoi.reference / 3
    assert (
        records["ellipsoid", "error of K: angle defect, barycentric"].value
        > records["ellipsoid", "error of K: angle defect, mixed Voronoi"].value
    )


def test_more_nodes_are_nearer_and_bounds_lie_above_the_truth():
    solver = Exaggerator(*MESH, Exaggerate(limit_cavities=False))
    errors = [row.value for row in measure_paths("torus", solver) if "error" in row.quantity]
    assert errors[:5] == sorted(errors[:5], reverse=True)
    assert errors[-1] < 0.01 * errors[0]
    bounds = [row for row in measure_blend_bounds("torus", solver, samples=5) if row.quantity.startswith("bound")]
    assert len(bounds) == 3 * 4
    assert all(row.value >= row.reference > 0 for row in bounds)


def test_every_solver_gives_the_same_answer():
    cotans = surface_solvers.CotanLaplacian(*MESH)
    matrix = cotans.stiffness()[1:][:, 1:].tocsc()
    right = np.random.default_rng(0).normal(size=(matrix.shape[0], 5))
    solvers = surface_solvers._solvers(matrix, surface_solvers.mixed_voronoi_areas(*MESH))
    answers = [make()(right) for make in solvers.values()]
    for answer in answers:
        np.testing.assert_allclose(answer, answers[0], atol=1e-5 * np.abs(answers[0]).max())


def test_times_and_their_plot(tmp_path, monkeypatch):
    monkeypatch.setattr(surface_solvers, "SIZES", 2)
    records = list(surface_solvers.measure_solvers(*MESH))
    assert {row.case.split(" ")[0] for row in records} == {"288", "1152"}
    records += measure_set_up("torus", MESH, Exaggerate(limit_cavities=False), 1)
    assert all(row.value > 0 for row in records)
    records += [*measure_sphere_law(range(2, 4)), *measure_curvature(range(2, 3))]
    solver = Exaggerator(*MESH, Exaggerate(limit_cavities=False))
    for preset in ("robust", "paper"):
        records += measure_blend_bounds(f"torus, {preset}", solver, samples=4)
    plot_surface(tmp_path / "surface.png", records, "torus", ("robust", "paper"))
    assert (tmp_path / "surface.png").stat().st_size > 10_000


def test_records_as_csv(tmp_path):
    records = [Measurement("a, b", "time", "s", 1 / 3), Measurement("c", "d", "1", 2, 4)]
    stream_csv(tmp_path / "rows.csv", records, Measurement)
    with (tmp_path / "rows.csv").open(newline="") as stream:
        assert list(csv.reader(stream)) == [
            ["case", "quantity", "unit", "value", "reference"],
            ["a, b", "time", "s", "0.333333", ""],
            ["c", "d", "1", "2", "4"],
        ]


def test_a_run_that_ends_early_leaves_its_records(tmp_path):
    def records():
        yield Measurement("a", "time", "s", 1.0)
        raise KeyboardInterrupt

    file = tmp_path / "folder" / "rows.csv"
    with pytest.raises(KeyboardInterrupt):
        stream_csv(file, records(), Measurement)
    assert not file.exists()
    assert (file.parent / ".rows.part.csv").read_text().splitlines()[1:] == ["a,time,s,1,"]
    stream_csv(file, [], Measurement)
    assert [left.name for left in file.parent.iterdir()] == ["rows.csv"]


def test_factors_hold_at_least_the_entries_of_the_system():
    solver = Exaggerator(*MESH, Exaggerate(limit_cavities=False))
    entries, times = surface_solvers.measure_fill_in("torus", solver, 1)
    assert min(entries.value, entries.reference) > solver.system.nnz
    assert min(times.value, times.reference) > 0


def test_what_takes_too_long_is_left_out_at_the_next_size(monkeypatch):
    monkeypatch.setattr(surface_solvers, "SIZES", 2)
    monkeypatch.setattr(surface_solvers, "MAX_FIRST_LEVEL", 0.0)
    records = list(surface_solvers.measure_solvers(*MESH))
    assert {row.case.split(" ")[0] for row in records} == {"288"}
    monkeypatch.setattr(surface_solvers, "MAX_FIRST_LEVEL", np.inf)
    monkeypatch.setattr(surface_solvers, "MOST_VERTICES", {"conjugate gradients": 300})
    sizes = [row.case.split(" ")[0] for row in surface_solvers.measure_solvers(*MESH) if "conjugate" in row.case]
    assert set(sizes) == {"288"}


def test_a_missing_mesh_is_named_before_work_starts(tmp_path):
    with pytest.raises(InputError, match=r"none\.obj: no such mesh"):
        read_heads([tmp_path / "none.obj"])
