"""Locks of jobs and studies."""

from __future__ import annotations

import shutil
import signal
import subprocess
import sys
from contextlib import contextmanager

import pytest
from processes import started

from carigs.errors import CarigsError
from carigs.runs.locks import job_lock, lock_study, remove_free_locks
from carigs.system.processes import this_process

HOLD = """
import sys, time
from pathlib import Path
from carigs.runs.locks import job_lock, lock_study
if sys.argv[2] == "job":
    lock = job_lock(Path(sys.argv[1]))
    lock.__enter__()
else:
    lock_study(Path(sys.argv[1]))
print("held", flush=True)
if sys.argv[3] == "wait":
    time.sleep(60)
"""


@contextmanager
def hold(path, kind: str, how: str = "wait"):
    command = [sys.executable, "-c", HOLD, str(path), kind, how]
    with started(command, stdout=subprocess.PIPE) as holder:
        assert holder.stdout.readline() == "held\n"
        yield holder
        if how == "end":
            holder.wait(timeout=60)  # it releases its lock at its end


def test_a_lock_has_one_holder_who_is_named_and_a_dead_one_is_followed(tmp_path):
    file = tmp_path / "train/all.lock"
    with hold(file, "job") as holder:
        with pytest.raises(CarigsError, match=f"process {holder.pid} on host {this_process().host}"):
            with job_lock(file, seconds=0.1):
                pass
        assert remove_free_locks(tmp_path) is False
        assert file.exists()
        holder.send_signal(signal.SIGKILL)
    assert file.exists()
    with job_lock(file, seconds=0.1):
        pass
    assert not file.exists()


def test_one_run_makes_a_study_at_a_time(tmp_path):
    with hold(tmp_path / "study/log", "study") as holder:
        with pytest.raises(CarigsError, match=f"another run makes this study: process {holder.pid} on host"):
            lock_study(tmp_path / "study/log")
        with hold(tmp_path / "other/log", "study", "end"):
            pass
        holder.send_signal(signal.SIGKILL)
    with hold(tmp_path / "study/log", "study", "end"):  # the system has released it
        pass
    assert not list(tmp_path.rglob("*.lock"))


def test_a_study_that_cannot_be_written_is_one_line(tmp_path):
    (tmp_path / "study").write_text("a file where the folder should be")
    with pytest.raises(CarigsError, match=r"run\.lock: .*; results are written here"):
        lock_study(tmp_path / "study/log")


def test_locks_of_dead_processes_are_removed(tmp_path):
    (tmp_path / "stage").mkdir()
    (tmp_path / "stage/all.lock").touch()
    assert remove_free_locks(tmp_path) is True
    assert not list(tmp_path.rglob("*.lock"))
    shutil.rmtree(tmp_path)
    assert remove_free_locks(tmp_path) is True


WITHOUT_FCNTL = """
import sys
from pathlib import Path
sys.modules["fcntl"] = None
from carigs.runs.locks import job_lock, lock_study, remove_free_locks
folder = Path(sys.argv[1])
lock_study(folder)
with job_lock(folder / "all.lock"):
    print(remove_free_locks(folder), list(folder.iterdir()))
"""


def test_without_the_module_for_locks_nothing_is_locked(tmp_path):
    """As on Windows."""
    command = [sys.executable, "-c", WITHOUT_FCNTL, str(tmp_path)]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "False []\n"
