"""The stress test of readers notices what it looks for."""

from __future__ import annotations

import csv
import os
import subprocess
import sys
from pathlib import Path

import pytest

from carigs.errors import InputError
from stress import hostile_files
from stress.hostile_cases.case import Case
from stress.hostile_files import read_case

TESTS = str(Path(__file__).parents[1])


def raising(error):
    def read(file):
        raise error if error is not InputError else InputError("bad", file=file)

    return read


@pytest.mark.parametrize(
    ("read", "case", "outcome"),
    [
        (raising(InputError), Case("a", "json", b""), "typed error"),
        (raising(InputError("bad", file="elsewhere")), Case("a", "json", b""), "NOT NAMED OR NOT ONE LINE"),
        (raising(KeyError("x")), Case("a", "json", b""), "TRACEBACK"),
        (raising(MemoryError()), Case("a", "json", b""), "TRACEBACK"),
        (lambda file: 1, Case("a", "json", b"", must_fail=True), "ACCEPTED"),
        (lambda file: 1, Case("a", "json", b"", protected=True), "SILENTLY WRONG"),
        (lambda file: 2, Case("a", "json", b"", protected=True), "right"),
    ],
)
def test_every_outcome_is_told(read, case, outcome, tmp_path, monkeypatch):
    monkeypatch.setitem(hostile_files.READERS, "json", (read, "a.json"))
    assert read_case(case, tmp_path, {"json": hostile_files.summary(2)})[0] == outcome


@pytest.mark.slow
def test_no_reader_runs_code_crashes_or_is_silently_wrong(tmp_path):
    command = [sys.executable, "-m", "stress.hostile_files", str(tmp_path / "rows.csv")]
    done = subprocess.run(command, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": TESTS})
    assert done.returncode == 0, done.stdout + done.stderr
    rows = list(csv.DictReader((tmp_path / "rows.csv").read_text().splitlines()))
    assert len(rows) >= 600 and {row["outcome"] for row in rows} == {"right", "typed error"}
