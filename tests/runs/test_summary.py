"""Warnings of jobs in their logs, and at the end of a run."""

from __future__ import annotations

import os
import warnings

import pytest

from carigs.errors import CarigsWarning
from carigs.runs.locks import job_lock
from carigs.runs.summary import error_lines, warning_lines, warnings_as_lines

SILENT = "the job ended without an error"
KILLED = "its process was killed, by the system, a scheduler or a user"


def test_warnings_become_lines_of_the_log_and_others_stay(capsys):
    with warnings_as_lines(), pytest.warns(UserWarning, match="another"):
        for _ in range(2):
            warnings.warn("a camera\nhas moved", CarigsWarning, stacklevel=1)
        warnings.warn("another", UserWarning, stacklevel=1)
    assert capsys.readouterr().err.splitlines() == ["carigs: warning: a camera\\nhas moved"] * 2


def test_every_warning_is_repeated_once_with_its_log(tmp_path):
    for stage, name, lines in (
        ("capture", "toy", ["hello", "carigs: warning: dark images"]),
        ("metrics", "a", ["carigs: warning: no weights", "carigs: warning: no weights"]),
        ("metrics", "b", ["carigs: warning: no weights", "carigs: no warning"]),
    ):
        file = tmp_path / stage / f"{name}.log"
        file.parent.mkdir(exist_ok=True)
        file.write_text("\n".join(lines))
    assert warning_lines([tmp_path]) == [
        f"dark images ({tmp_path}/capture/toy.log)",
        f"no weights ({tmp_path}/metrics/a.log and 1 more)",
    ]
    assert warning_lines([tmp_path / "nothing"]) == []
    # Of two studies with the same warnings each is one line.
    dark, weights = warning_lines([tmp_path, tmp_path])
    assert dark.endswith("toy.log and 1 more)") and weights.endswith("a.log and 3 more)")


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("reading\ncarigs: out.json: a.png: no such image\n", "out.json: a.png: no such image"),
        ("carigs: warning: dark images\n", f"{SILENT} after it wrote: carigs: warning: dark images; {KILLED}"),
        ("carigs: out.json: an old line\nstep 7\n", f"{SILENT} after it wrote: step 7; {KILLED}"),
        ("", f"{SILENT} before it wrote anything; {KILLED}"),
        (None, f"{SILENT} before it wrote anything; {KILLED}"),
    ],
)
def test_the_error_of_a_job_is_the_last_line_of_its_log(text, expected, tmp_path):
    log = tmp_path / "a.log"
    if text is not None:
        log.write_text(text)
    assert error_lines([log]) == [f"{expected} ({log})"]


@pytest.mark.parametrize("text", [None, "", "step 7\n"])
def test_a_job_that_another_process_still_runs_was_not_killed(text, tmp_path):
    log = tmp_path / "a.log"
    if text is not None:
        log.write_text(text)
    with job_lock(log.with_suffix(".lock")):
        (line,) = error_lines([log])
    assert line.startswith("this run did not start the job: ") and f"process {os.getpid()} on host" in line
    assert "killed" not in line
