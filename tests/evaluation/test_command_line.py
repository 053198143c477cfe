"""Exit status and help of the programs."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

PROGRAMS = ("stress.surface", "stress.heads", "evaluation.benchmarks.surface")
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[1])}


def run(program, *arguments):
    command = [sys.executable, "-m", program, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=False, env=ENVIRONMENT)


@pytest.mark.slow
@pytest.mark.parametrize("program", PROGRAMS)
def test_a_missing_mesh_ends_in_one_line_and_status_one(program, tmp_path):
    done = run(program, tmp_path / "rows.csv", tmp_path / "none.obj")
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("carigs: ") and "no such mesh" in done.stderr
    assert "Traceback" not in done.stderr and not (tmp_path / "rows.csv").exists()


@pytest.mark.slow
def test_help_has_an_example():
    done = run("stress.surface", "--help")
    assert done.returncode == 0 and "python -m stress.surface results" in done.stdout
