"""Records of jobs and their locks."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest

from carigs.errors import CarigsError, InputError
from carigs.job_lock import job_lock, remove_free_locks
from carigs.job_record import STALE, is_stale, job_costs, recorded_job, set_modification_times, unfinished_jobs
from carigs.lap_times import timed
from carigs.processes import this_process


def job(
    root: Path, stage: str, inputs: list[str], outputs: list[str], text: str, outside: dict[str, str] | None = None
) -> None:
    """A job that writes `text` into its outputs."""
    settings = root / f"settings/{stage}/all.yaml"
    settings.parent.mkdir(parents=True, exist_ok=True)
    settings.write_text(text)
    paths = [[root / name for name in names] for names in (inputs, outputs)]
    with recorded_job(root / f"log/{stage}/all.log", settings, "code", *paths, outside or {}):
        for output in paths[1]:
            output.parent.mkdir(parents=True, exist_ok=True)
            output.write_text(text)


@pytest.fixture
def study(tmp_path):
    job(tmp_path, "path", [], ["path.npz"], "a")
    job(tmp_path, "train", ["path.npz"], ["avatar/a.npz", "avatar/log.csv"], "b")
    return tmp_path


def texts(**texts: str) -> Callable:
    return lambda stage, point: {"path": "a", "train": "b", **texts}[stage]


def same_code(stage: str) -> str:
    return "code"


def nothing(path: str) -> str:
    return ""


def test_nothing_is_marked_without_a_difference(study):
    times = {file: file.stat().st_mtime_ns for file in study.rglob("*")}
    assert set_modification_times(study / "log", texts(), same_code, nothing) == {}
    assert times == {file: file.stat().st_mtime_ns for file in study.rglob("*")}


def test_other_settings_or_code_mark_the_outputs_until_they_are_back(study):
    before = (study / "avatar/a.npz").stat().st_mtime_ns
    for text, code, reason in ((texts(train="c"), same_code, "settings"), (texts(), lambda stage: stage, "code")):
        stale = set_modification_times(study / "log", text, code, nothing)
        assert stale["train", f"made with other {reason}"] == 1
        assert is_stale(study / "avatar/a.npz") and is_stale(study / "avatar/log.csv")
        assert set_modification_times(study / "log", texts(), same_code, nothing) == {}
        assert 0 <= (study / "avatar/a.npz").stat().st_mtime_ns - before < 1e9


def test_an_output_that_was_made_again_marks_what_was_made_from_it(study):
    job(study, "path", [], ["path.npz"], "a2")
    assert set_modification_times(study / "log", texts(path="a2"), same_code, nothing) == {
        ("train", "made from other inputs"): 1
    }
    job(study, "path", [], ["path.npz"], "a")
    assert set_modification_times(study / "log", texts(), same_code, nothing) == {}


def test_a_file_outside_of_the_study_marks_what_was_made_from_it_unless_it_is_not_there(study):
    job(study, "path", [], ["path.npz"], "a", outside={"anna": "old"})
    job(study, "train", ["path.npz"], ["avatar/a.npz", "avatar/log.csv"], "b")
    for present, marked in (("old", {}), ("", {}), ("new", {("path", "made from another state of anna"): 1})):
        assert set_modification_times(study / "log", texts(), same_code, {"anna": present}.get) == marked
        assert is_stale(study / "path.npz") == bool(marked)
        assert not is_stale(study / "avatar/a.npz")


def test_a_job_that_is_killed_while_it_makes_an_output_again_marks_what_was_made_from_it(study):
    """Snakemake removes outputs before the job, and does not make them again for results that look current."""
    path, record = study / "path.npz", study / "log/path/all.json"
    whole = record.read_text()
    with pytest.raises(KeyboardInterrupt):
        with recorded_job(study / "log/path/all.log", study / "settings/path/all.yaml", "code", [], [path], {}):
            path.unlink()
            raise KeyboardInterrupt
    assert set_modification_times(study / "log", texts(), same_code, nothing)["train", "made from other inputs"] == 1
    assert is_stale(study / "avatar/a.npz")
    path.write_text("a")
    record.write_text(whole)
    assert set_modification_times(study / "log", texts(), same_code, nothing) == {}
    assert not is_stale(study / "avatar/a.npz")


def test_a_job_that_fails_or_is_killed_marks_its_outputs(study):
    with pytest.raises(RuntimeError):
        with recorded_job(
            study / "log/train/all.log", study / "settings/train/all.yaml", "code", [], [study / "avatar/a.npz"], {}
        ):
            raise RuntimeError
    assert set_modification_times(study / "log", texts(), same_code, nothing) == {("train", "not finished"): 1}
    assert is_stale(study / "avatar/a.npz")


def test_a_copy_gets_its_times_back_but_not_for_what_was_edited(study):
    order = [(study / name).stat().st_mtime_ns for name in ("path.npz", "avatar/log.csv")]
    (study / "avatar/a.npz").write_text("edited")
    for file in study.rglob("*"):
        os.utime(file, ns=(10**18, 10**18))
    assert set_modification_times(study / "log", texts(), same_code, nothing) == {}
    restored = [(study / name).stat().st_mtime_ns for name in ("path.npz", "avatar/log.csv")]
    assert all(0 <= new - old < 1e9 for new, old in zip(restored, order, strict=True))
    assert (study / "avatar/a.npz").stat().st_mtime_ns == 10**18
    assert (study / "settings/train/all.yaml").stat().st_mtime_ns in range(STALE + 1, min(restored))


def test_an_output_from_the_future_gets_its_time_back_or_the_present(study):
    before, future = (study / "path.npz").stat().st_mtime_ns, 4 * 10**18
    (study / "avatar/a.npz").write_text("edited")
    for name in ("path.npz", "avatar/a.npz"):
        os.utime(study / name, ns=(future, future))
    assert set_modification_times(study / "log", texts(), same_code, nothing) == {}
    assert 0 <= (study / "path.npz").stat().st_mtime_ns - before < 1e9
    assert 0 <= time.time_ns() - (study / "avatar/a.npz").stat().st_mtime_ns < 5e9


@pytest.mark.parametrize("text", ["", "{", "[]", "{}", '{"finished": 3, "outputs": {}}'])
def test_a_damaged_record_is_named(study, text):
    (study / "log/train/all.json").write_text(text)
    with pytest.raises(InputError, match=r"all\.json"):
        set_modification_times(study / "log", texts(), same_code, nothing)


HOLD = """
import sys, time
from pathlib import Path
from carigs.job_lock import job_lock
with job_lock(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def test_a_lock_has_one_holder_who_is_named_and_a_dead_one_is_followed(tmp_path):
    file = tmp_path / "all.lock"
    with subprocess.Popen([sys.executable, "-c", HOLD, str(file)], stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(CarigsError, match=f"process {holder.pid} on host {this_process().host}"):
            with job_lock(file, seconds=0.1):
                pass
        remove_free_locks(tmp_path)
        assert file.exists()
        holder.send_signal(signal.SIGKILL)
    assert file.exists()
    with job_lock(file, seconds=0.1):
        pass
    assert not file.exists()


def test_locks_of_dead_processes_are_removed(tmp_path):
    (tmp_path / "stage").mkdir()
    (tmp_path / "stage/all.lock").touch()
    remove_free_locks(tmp_path)
    assert not list(tmp_path.rglob("*.lock"))
    shutil.rmtree(tmp_path)
    remove_free_locks(tmp_path)


WITHOUT_FCNTL = """
import sys
from pathlib import Path
sys.modules["fcntl"] = None
from carigs.job_lock import job_lock, remove_free_locks
folder = Path(sys.argv[1])
with job_lock(folder / "all.lock"):
    remove_free_locks(folder)
    print(list(folder.iterdir()))
"""


def test_without_the_module_for_locks_nothing_is_locked(tmp_path):
    """As on Windows."""
    command = [sys.executable, "-c", WITHOUT_FCNTL, str(tmp_path)]
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == "[]\n"


def test_jobs_that_failed_since_a_time_are_listed_in_order(study):
    start = time.time() - 1
    assert unfinished_jobs(study / "log", start) == []
    for stage in ("render", "metrics"):
        with pytest.raises(CarigsError), recorded_job(study / f"log/{stage}/a.log", study, "code", [], [], {}):
            raise CarigsError("no such image")
        os.utime(study / f"log/{stage}/a.json", (start + 2, start + (1 if stage == "render" else 2)))
    assert unfinished_jobs(study / "log", start) == [study / "log/render/a.log", study / "log/metrics/a.log"]
    assert unfinished_jobs(study / "log", start + 1.5) == [study / "log/metrics/a.log"]
    assert unfinished_jobs(study / "nothing", start) == []


def test_times_of_steps_are_those_of_the_job_alone_and_leave_out_the_first(tmp_path, monkeypatch):
    settings = tmp_path / "settings/render/all.yaml"
    settings.parent.mkdir(parents=True)
    settings.write_text("")
    clock = iter([0, 50, 100, 120, 200, 201, 300, 303])  # begin and end of each step
    monkeypatch.setattr("carigs.lap_times.time", SimpleNamespace(perf_counter=lambda: next(clock)))
    with timed("frame"):  # before the job
        pass
    with recorded_job(tmp_path / "log/render/all.log", settings, "code", [], [], {}):
        for _ in range(3):
            with timed("frame"):
                pass
    assert job_costs(tmp_path / "log")["render", "all"].steps == {"frame": 2}
