"""Jobs end in one line whatever is wrong with their disk."""

from __future__ import annotations

import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from carigs.config import settings_text
from carigs.errors import CarigsError
from carigs.run_summary import error_lines
from carigs.stages.job import run_job


@pytest.mark.parametrize("target", ["/dev/full", "/nowhere/a.log"])
def test_a_log_that_cannot_be_written_is_one_line(target, tmp_path, capsys):
    if not Path("/dev/full").exists():
        pytest.skip("only Linux has /dev/full")
    log, outputs = tmp_path / "log/tabulate/a.log", [str(tmp_path / "table.csv")]
    log.parent.mkdir(parents=True)
    log.symlink_to(target)
    assert run_job("tabulate", str(tmp_path / "none.yaml"), {}, {}, "", [], outputs, {}, str(log)) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"carigs: {outputs[0]}: ")


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
    assert run_job("tabulate", str(settings), {}, {}, "", [], ["table.csv"], {}, str(log)) == 1
    (line,) = error_lines([log])
    assert line.startswith(f"table.csv: {words}")
    assert ("Traceback" in log.read_text()) == ("Traceback" in capsys.readouterr().err) == is_traced
