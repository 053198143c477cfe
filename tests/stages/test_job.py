"""Jobs end in one line whatever is wrong with their disk."""

from __future__ import annotations

from pathlib import Path

import pytest

from carigs.stages.job import run_job


@pytest.mark.parametrize("target", ["/dev/full", "/nowhere/a.log"])
def test_a_log_that_cannot_be_written_is_one_line(target, tmp_path, capsys):
    if not Path("/dev/full").exists():
        pytest.skip("only Linux has /dev/full")
    log, outputs = tmp_path / "log/tabulate/a.log", [str(tmp_path / "table.csv")]
    log.parent.mkdir(parents=True)
    log.symlink_to(target)
    assert run_job("tabulate", str(tmp_path / "none.yaml"), {}, {}, "", [], outputs, str(log)) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"carigs: {outputs[0]}: ")
