"""Jobs end in one line whatever is wrong with their disk."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from carigs.config import compose, settings_text
from carigs.errors import CarigsError
from carigs.runs.plan import settings_digest
from carigs.runs.sources import fingerprint
from carigs.runs.summary import error_lines
from carigs.stages.job import run_job


def job(log: Path, output: str | Path, **plan: str) -> dict:
    """Fields of a job of the stage `tabulate`."""
    settings, code = settings_digest("tabulate", compose().tabulate), fingerprint("carigs.stages.tabulate")
    planned = {"settings": settings, "code": code, "packages": {}, "outside": {}}
    return {"log": str(log), "plan": planned | plan, "params": {}, "inputs": [], "outputs": [str(output)]}


@pytest.mark.parametrize("target", ["/dev/full", "/nowhere/a.log"])
def test_a_log_that_cannot_be_written_is_one_line(target, tmp_path, capsys):
    if not Path("/dev/full").exists():
        pytest.skip("only Linux has /dev/full")
    log, output = tmp_path / "log/tabulate/a.log", tmp_path / "table.csv"
    log.parent.mkdir(parents=True)
    log.symlink_to(target)
    assert run_job(str(tmp_path / "none.yaml"), {}, job(log, output)) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"carigs: {output}: ")


@pytest.mark.parametrize(
    ("error", "words", "is_traced"),
    [
        (CarigsError("a.png: no such image"), "a.png: no such image", False),
        (ZeroDivisionError("by\nzero"), "ZeroDivisionError: by\\nzero; this is an error of carigs", True),
    ],
)
def test_the_last_line_of_the_log_is_the_error(error, words, is_traced, tmp_path, monkeypatch, capsys):
    def stage(settings, **keywords):
        print("half of the table")
        raise error

    monkeypatch.setitem(sys.modules, "carigs.stages.tabulate", SimpleNamespace(tabulate=stage))
    log, settings = tmp_path / "log/tabulate/a.log", tmp_path / "all.yaml"
    log.parent.mkdir(parents=True)
    settings.write_text(settings_text("tabulate"))
    assert run_job(str(settings), {}, job(log, "table.csv")) == 1
    (line,) = error_lines([log])
    assert line.startswith(f"table.csv: {words}")
    assert ("Traceback" in log.read_text()) == ("Traceback" in capsys.readouterr().err) == is_traced


def test_a_job_refuses_settings_that_another_run_has_replaced(tmp_path, capsys):
    """Where no lock holds another run back: the job would make results of settings that nobody planned."""
    log, settings = tmp_path / "log/tabulate/a.log", tmp_path / "all.yaml"
    log.parent.mkdir(parents=True)
    settings.write_text(settings_text("tabulate", "tabulate.reference=surfhead"))
    assert run_job(str(settings), {}, job(log, "table.csv")) == 1
    assert "all.yaml: another run has replaced the settings" in capsys.readouterr().err


@pytest.mark.parametrize("edited", [True, False])
def test_a_job_refuses_code_that_was_edited_after_the_run_was_planned(edited, tmp_path, monkeypatch, capsys):
    """Sources are read only if one of them is newer than the plan."""
    monkeypatch.setitem(sys.modules, "carigs.stages.tabulate", SimpleNamespace(tabulate=lambda settings: None))
    monkeypatch.setenv("CARIGS_PLANNED_AT", "1" if edited else f"{10**19}")
    log, settings = tmp_path / "log/tabulate/a.log", tmp_path / "all.yaml"
    log.parent.mkdir(parents=True)
    settings.write_text(settings_text("tabulate"))
    assert run_job(str(settings), {}, job(log, tmp_path / "table.csv", code="of an earlier state")) == edited
    assert ("the code of this stage was edited" in capsys.readouterr().err) == edited
    assert run_job(str(settings), {}, job(log, tmp_path / "table.csv")) == 0


def test_a_stage_that_can_resume_gets_the_key_of_the_record(tmp_path, monkeypatch):
    """Equal jobs have one key; another version of a package is another key."""
    keys = []

    def stage(settings, resume_key):
        keys.append(resume_key)

    monkeypatch.setitem(sys.modules, "carigs.stages.tabulate", SimpleNamespace(tabulate=stage))
    log, settings = tmp_path / "log/tabulate/a.log", tmp_path / "all.yaml"
    log.parent.mkdir(parents=True)
    settings.write_text(settings_text("tabulate"))
    for plan in ({}, {}, {"packages": {"numpy": "9"}}, {"outside": {"data": "other"}}):
        assert run_job(str(settings), {}, job(log, tmp_path / "table.csv", **plan)) == 0
    assert keys[0] == keys[1] and len({*keys}) == 3
