"""The report on a GPU: parts that fail, hang or are cut do not end the others, and all of them are reported."""

import json
import sys

import pytest
import torch

from carigs.errors import CarigsError
from evaluation.benchmarks.gpu import checks
from evaluation.benchmarks.gpu.__main__ import main
from evaluation.benchmarks.gpu.document import table
from evaluation.benchmarks.gpu.figures import Figure, Task, read_figures, write_figures
from evaluation.benchmarks.gpu.runner import LIMITS, run_part


def test_figures_of_a_part_that_fails_are_kept(tmp_path):
    def figures():
        yield Figure("a", "speed", 3.0, "1/s")
        yield Figure("a", "name", "one")
        raise RuntimeError

    with pytest.raises(RuntimeError):
        write_figures(tmp_path / "a.jsonl", figures())
    with (tmp_path / "a.jsonl").open("a") as stream:
        stream.write('{"case": "cut')
    assert list(read_figures(tmp_path / "a.jsonl")) == [Figure("a", "speed", 3.0, "1/s"), Figure("a", "name", "one")]
    assert list(read_figures(tmp_path / "none.jsonl")) == []


def test_a_part_that_takes_too_long_is_ended(tmp_path):
    part = run_part("networks", "cpu", tmp_path, 0.2)  # the import of torch alone takes longer
    assert part["end"] == "out of time" and part["seconds"] < 2


def test_all_parts_are_reported_and_one_that_fails_is_the_exit_status(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["gpu", str(tmp_path), "--device", "cpu", "--parts", "kernels", "machine"])
    assert main() is True
    report = json.loads((tmp_path / "gpu.json").read_text())
    assert [(part["part"], part["end"]) for part in report["parts"]] == [("kernels", "failed"), ("machine", "done")]
    assert report["parts"][0]["why"] == "carigs: only CUDA devices have kernels to compile"  # one line
    assert report["parts"][0]["figures"] == []
    assert {figure["case"] for figure in report["parts"][1]["figures"]} >= {"processor", "torch", "gsplat", "nvcc"}
    assert "| kernels | **failed** |" in capsys.readouterr().out


def test_the_table_counts_tests_and_rounds_figures():
    figures = [Figure("one", "test", "passed"), Figure("two", "test", "passed"), Figure("three", "test", "skipped: no")]
    parts = [
        {"part": "checks", "end": "done", "why": "", "figures": [figure._asdict() for figure in figures]},
        {"part": "frames", "end": "done", "why": "", "figures": [Figure("x", "rendering", 123.456, "1/s")._asdict()]},
        {"part": "networks", "end": "out of time", "why": "a | b", "figures": []},
    ]
    rows = table(parts).splitlines()[2:]
    assert rows == [
        "| checks | tests | passed | 2 |",
        "| checks | tests | skipped | 1 |",
        "| frames | x | rendering | 123.5 1/s |",
        "| networks | **out of time** | a ; b | |",
    ]
    assert {part["part"] for part in parts} < set(LIMITS)


@pytest.mark.slow
@pytest.mark.parametrize("part", ["frames", "networks"])
def test_a_part_can_be_tried_without_a_gpu(tmp_path, part):
    result = run_part(part, "cpu", tmp_path, 300)
    assert result["end"] == "done", result["why"]
    assert result["figures"]


@pytest.mark.slow
def test_the_tests_of_the_twins_are_reported(monkeypatch):
    """One of them: `make test` runs all."""
    monkeypatch.setitem(checks.TESTS, "cpu", (*checks.TESTS["cpu"], "-k", "test_colours and True-3"))
    found = list(checks.measure(Task(torch.device("cpu"))))
    assert found == [Figure("test_colours[True-3]", "test", "passed")]


@pytest.mark.slow
def test_no_test_is_a_failure(monkeypatch):
    monkeypatch.setitem(checks.TESTS, "cpu", (*checks.TESTS["cpu"], "-k", "nowhere"))
    with pytest.raises(CarigsError, match="0 passed"):
        list(checks.measure(Task(torch.device("cpu"))))
