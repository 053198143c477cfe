"""Outcomes of cases: what is right, a typed error or wrong; and the programs that run and count them."""

import csv
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from carigs.errors import InputError, MeshError
from evaluation.command_line import run
from evaluation.tables.csv_files import write_csv
from stress import raster, summary
from stress.case import Case, Measure, Outcome, difference, examine, run_suite, violations


def raising(error):
    def measure():
        raise error

    return measure


HOLDS, FAILS = Measure("a", 0.5, 1.0), Measure("b", 2.0, 1.0)


@pytest.mark.parametrize(
    ("case", "outcome"),
    [
        (Case("a", lambda: [HOLDS]), "right"),
        (Case("a", lambda: [HOLDS, FAILS]), "wrong"),
        (Case("a", lambda: [Measure("a", float("nan"), 1.0), HOLDS]), "wrong"),
        (Case("a", lambda: []), "wrong"),
        (Case("a", lambda: iter([FAILS])), "wrong"),
        (Case("a", raising(MeshError("bad"))), "wrong"),
        (Case("a", raising(ZeroDivisionError())), "wrong"),
        (Case("a", raising(InputError("bad", file="f")), invalid=True), "typed error"),
        (Case("a", raising(ValueError("bad")), invalid=True), "wrong"),
        (Case("a", lambda: [HOLDS], invalid=True), "wrong"),
    ],
)
def test_every_outcome_is_told(case, outcome):
    found = examine("suite", case)
    assert found.outcome == outcome
    assert found.holds == (outcome != "wrong")


def test_the_reported_number_is_the_one_closest_to_its_tolerance():
    measures = [Measure("a", 0.5, 1.0), Measure("b", 1e-9, 1.1e-9), Measure("c", 0.0, 0.0), Measure("d", 7.0, 10.0)]
    assert examine("suite", Case("a", lambda: measures))[3:] == (1e-9, 1.1e-9, "b")


@given(st.floats(allow_nan=False, allow_infinity=False, width=32), st.integers(0, 5))
def test_the_difference_is_the_largest_one(change, place):
    values = np.zeros(6)
    values[place] = change
    assert difference("a", values, np.zeros(6), 1.0).error == abs(change)


def test_infinite_values_agree_with_themselves_alone():
    infinite = np.array([1.0, np.inf, -np.inf])
    assert difference("a", infinite, infinite, 0.0).holds
    assert not difference("a", infinite, -infinite, 1e300).holds
    assert not difference("a", np.array([np.nan]), np.array([np.nan]), np.inf).holds
    assert not difference("a", np.zeros(3), np.zeros(2), np.inf).error < np.inf


def test_violations_are_counted():
    assert violations("a", np.array([[True, False], [True, True]])) == Measure("a", 3.0, 0.0)
    assert violations("a", np.zeros((0, 3), bool)).holds


def run_on(monkeypatch, file, cases, *options):
    monkeypatch.setattr(sys, "argv", ["suite", str(file), *options])
    return run_suite("A suite.", "suite", cases)


def test_a_suite_writes_all_outcomes_and_fails_if_a_case_is_wrong(tmp_path, monkeypatch, capsys):
    cases = [
        Case("good", lambda: [HOLDS]),
        Case("bad", lambda: [FAILS]),
        Case("refused", raising(MeshError("x")), True),
    ]
    assert run_on(monkeypatch, tmp_path / "suite.csv", cases)
    assert "3 cases: 1 right, 1 typed error, 1 wrong\n  bad: b: 2 > 1\n" == capsys.readouterr().out
    with (tmp_path / "suite.csv").open(newline="") as stream:
        assert [row["outcome"] for row in csv.DictReader(stream)] == ["right", "wrong", "typed error"]
    assert not run_on(monkeypatch, tmp_path / "suite.csv", cases, "--keep-going")
    assert not run_on(monkeypatch, tmp_path / "suite.csv", [cases[0], cases[2]])


def write_rows(file, *outcomes):
    rows = [Outcome(file.stem, str(k), outcome, None, None, "why") for k, outcome in enumerate(outcomes)]
    write_csv(file, rows, Outcome)
    return str(file)


@pytest.mark.parametrize("odd", ["wrong", "CRASH (-11)"])
def test_the_summary_counts_by_suite_and_fails_on_any_wrong_case(odd, tmp_path, monkeypatch, capsys):
    sound = write_rows(tmp_path / "sound.csv", "right", "right", "typed error")
    broken = write_rows(tmp_path / "broken.csv", "right", odd)
    monkeypatch.setattr(sys, "argv", ["summary", str(tmp_path / "summary.csv"), sound, broken])
    assert summary.main()
    assert capsys.readouterr().out.endswith("broken: 1: why\n")
    with (tmp_path / "summary.csv").open(newline="") as stream:
        rows = [tuple(row.values()) for row in csv.DictReader(stream)]
    assert rows == [("sound", "3", "2", "1", "0"), ("broken", "2", "1", "0", "1"), ("total", "5", "3", "1", "1")]
    monkeypatch.setattr(sys, "argv", ["summary", str(tmp_path / "summary.csv"), sound])
    assert not summary.main()


def test_a_defect_in_a_kernel_is_wrong_and_the_program_fails(tmp_path, monkeypatch, capsys):
    """The rasterizer loses the last column of every image."""
    compute = raster.compute_visibility

    def without_last_column(*arguments, **options):
        seen = compute(*arguments, **options)
        seen.face[:, -1] = -1
        return seen

    def main():
        chosen = (case for case in raster.cases() if case.name.startswith("ball, close by"))
        return run_suite("A suite.", "raster", chosen)

    monkeypatch.setattr(sys, "argv", ["raster", str(tmp_path / "raster.csv")])
    assert not main()
    monkeypatch.setattr(raster, "compute_visibility", without_last_column)
    assert main()
    assert "pixels that show another face" in capsys.readouterr().out
    with pytest.raises(SystemExit, match="1"):
        run(main)
