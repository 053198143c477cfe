"""Records of jobs, and which results are current by them."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from carigs.errors import CarigsError
from carigs.runs.contents import content_digest
from carigs.runs.current_results import outdated_jobs
from carigs.runs.job_record import job_costs, recorded_job, unfinished_jobs
from carigs.runs.lap_times import timed
from carigs.runs.planned_job import PlannedJob

TRIGGERS = ("params", "software-env", "input", "mtime")
PLAN = {"settings": "s", "code": "c", "packages": {"numpy": "2.0", "cholespy": ""}, "outside": {"anna": "old"}}


@pytest.fixture
def planned(tmp_path) -> dict[str, PlannedJob]:
    """A chain of three jobs; one of them writes a folder."""

    def job(stage: str, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> PlannedJob:
        paths = [tuple(str(tmp_path / name) for name in names) for names in (inputs, outputs)]
        return PlannedJob(f"{tmp_path}/log/{stage}/all.log", PLAN, {"level": 0.25, "levels": (0, 1)}, *paths)

    return {
        "path": job("path", ("settings.yaml",), ("path.npz",)),
        "train": job("train", ("path.npz",), ("avatar.npz", "log.csv")),
        "render": job("render", ("avatar.npz",), ("frames",)),
    }


def run(job: PlannedJob, text: str = "") -> str:
    """A job that writes a text and its name into its outputs; returns its key."""
    with recorded_job(job) as key:
        for output in map(Path, job.outputs):
            output.parent.mkdir(parents=True, exist_ok=True)
            if output.name == "frames":
                output.mkdir(exist_ok=True)
                output /= "0.png"
            output.write_text(f"{text} of {job.stage}")
    return key


@pytest.fixture
def made(planned, tmp_path) -> dict[str, PlannedJob]:
    (tmp_path / "settings.yaml").write_text("a: 1")
    for job in planned.values():
        run(job)
    return planned


def outdated(jobs: dict[str, PlannedJob], triggers=TRIGGERS, **changed: PlannedJob) -> dict[str, str]:
    """Reasons by stage, for jobs of which some are planned otherwise."""
    jobs = {**jobs, **changed}
    text = Path(jobs["path"].inputs[0])
    found = outdated_jobs(jobs.values(), {str(text): content_digest(text)}, triggers)
    return {job.stage: reason for job, reason in found.items()}


def with_plan(job: PlannedJob, **changes) -> PlannedJob:
    return replace(job, plan={**job.plan, **changes})


def test_what_has_just_been_made_is_current_and_looking_changes_nothing(made, tmp_path):
    before = {file: (file.stat().st_mtime_ns, file.read_bytes()) for file in tmp_path.rglob("*") if file.is_file()}
    assert outdated(made) == {}
    assert before == {
        file: (file.stat().st_mtime_ns, file.read_bytes()) for file in tmp_path.rglob("*") if file.is_file()
    }


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (lambda job: with_plan(job, settings="t"), "made with other settings"),
        (lambda job: replace(job, params={**job.params, "level": 0.5}), "made with other settings"),
        (lambda job: with_plan(job, code="d"), "made with other code"),
        (lambda job: with_plan(job, packages={"numpy": "3.0", "cholespy": ""}), "made with another version of numpy"),
        (lambda job: with_plan(job, packages={"numpy": "2.0", "cholespy": "2.2"}), "another version of cholespy"),
        (lambda job: with_plan(job, packages={"cholespy": ""}), "made with another version of numpy"),
        (lambda job: with_plan(job, outside={"anna": "new"}), "made from another state of anna"),
        (lambda job: with_plan(job, outside={"anna": "old", "b": "x"}), "made from another state of b"),
        (lambda job: replace(job, inputs=(*job.inputs, job.log)), "made from other inputs"),
        (lambda job: replace(job, inputs=()), "made from other inputs"),
    ],
)
def test_a_difference_of_the_plan_makes_outputs_outdated_until_it_is_undone(made, change, reason):
    found = outdated(made, train=change(made["train"]))
    assert set(found) == {"train"} and reason in found["train"]
    assert outdated(made) == {}


def test_a_dataset_that_is_not_there_leaves_results_current(made):
    assert outdated(made, train=with_plan(made["train"], outside={"anna": ""})) == {}


@pytest.mark.parametrize(
    ("trigger", "change"),
    [
        ("params", lambda job: with_plan(job, settings="t")),
        ("params", lambda job: with_plan(job, code="d")),
        ("software-env", lambda job: with_plan(job, packages={})),
        ("input", lambda job: replace(job, inputs=())),
        ("mtime", lambda job: with_plan(job, outside={"anna": "new"})),
    ],
)
def test_a_trigger_that_the_user_switches_off_does_not_count(made, trigger, change):
    changed = change(made["train"])
    assert outdated(made, train=changed) and not outdated(made, set(TRIGGERS) - {trigger}, train=changed)


def touch(file: Path, seconds: float | None = None) -> None:
    """Set a modification time, far away or after the present one."""
    then = 10**18 if seconds is None else time.time_ns() + int(seconds * 1e9)
    os.utime(file, ns=(then, then))


DAMAGES = {
    "cut": lambda file: file.write_bytes(file.read_bytes()[:-1]),
    "empty": lambda file: file.write_bytes(b""),
    "of the same size, later": lambda file: (file.write_bytes(file.read_bytes()[::-1]), touch(file)),
    "of the same size, soon": lambda file: (file.write_bytes(file.read_bytes()[::-1]), touch(file, seconds=30)),
}


@pytest.mark.parametrize("damage", DAMAGES.values(), ids=DAMAGES.keys())
@pytest.mark.parametrize(("file", "stage"), [("avatar.npz", "train"), ("log.csv", "train"), ("frames/0.png", "render")])
def test_a_damaged_output_is_made_again_and_the_rest_kept(made, tmp_path, damage, file, stage):
    damage(tmp_path / file)
    assert outdated(made) == {stage: "changed or damaged since"}


@pytest.mark.parametrize("change", [lambda f: (f / "0.png").unlink(), lambda f: (f / "1.png").touch()])
def test_a_file_that_is_missing_or_added_in_a_folder_is_a_damage(made, tmp_path, change):
    change(tmp_path / "frames")
    assert outdated(made) == {"render": "changed or damaged since"}


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "{}", '{"finished": 3, "outputs": {}}', '{"outputs": 3, "finished": 1}']
)
def test_outputs_without_a_record_that_can_be_read_are_made_again(made, tmp_path, text):
    (tmp_path / "log/train/all.json").write_text(text)
    assert outdated(made) == {"train": "made by a job of which no record can be read"}
    assert set(job_costs(tmp_path / "log")) == {("path", "all"), ("render", "all")}


@pytest.mark.parametrize("state", [5, None, "a b", "-1 3", "1 2 3", ""])
def test_a_state_that_no_job_writes_means_that_contents_are_read_or_the_record_is_damaged(made, tmp_path, state):
    file = tmp_path / "log/train/all.json"
    record = json.loads(file.read_text())
    record["outputs"][str(tmp_path / "avatar.npz")]["state"] = state
    file.write_text(json.dumps(record))
    expected = {} if isinstance(state, str) else {"train": "made by a job of which no record can be read"}
    assert outdated(made) == expected


@pytest.mark.parametrize("outputs", [{}, {"another": {"digest": "d", "state": "s"}}])
def test_a_record_of_other_outputs_says_nothing_of_these(made, tmp_path, outputs):
    file = tmp_path / "log/train/all.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), "outputs": outputs}))
    assert outdated(made) == {"train": "made by a job with other outputs"}


@pytest.mark.parametrize("costs", [[1], {}, {"seconds": "long", "cpu_seconds": 1}])
def test_costs_that_cannot_be_read_are_not_known(made, tmp_path, costs):
    file = tmp_path / "log/train/all.json"
    file.write_text(json.dumps({**json.loads(file.read_text()), "costs": costs}))
    assert set(job_costs(tmp_path / "log")) == {("path", "all"), ("render", "all")}


def test_a_job_records_what_it_has_read_and_not_what_was_once_written(made, tmp_path):
    """An input that was damaged when the job read it, and is whole again."""
    whole = (tmp_path / "avatar.npz").read_bytes()
    (tmp_path / "avatar.npz").write_bytes(b"damaged")
    run(made["render"])
    (tmp_path / "avatar.npz").write_bytes(whole)
    assert outdated(made) == {"render": "made from other inputs"}


def test_a_record_that_is_a_folder_is_replaced(made, tmp_path):
    file = tmp_path / "log/train/all.json"
    file.unlink()
    (file / "inside").mkdir(parents=True)
    assert outdated(made) == {"train": "made by a job of which no record can be read"}
    run(made["train"])
    assert outdated(made) == {}


def test_jobs_that_have_never_run_are_not_listed(planned):
    assert outdated(planned) == {}


def test_what_was_made_from_an_intermediate_that_is_no_longer_known_is_made_again(made, tmp_path):
    (tmp_path / "path.npz").unlink()
    assert outdated(made) == {}  # the record still says what it was
    (tmp_path / "log/path/all.json").unlink()
    assert outdated(made) == {"train": "made from other inputs"}


def test_a_copy_without_modification_times_is_current(made, tmp_path):
    for file in tmp_path.rglob("*"):
        touch(file)
    assert outdated(made) == {}


def test_the_time_that_snakemake_sets_after_the_job_is_no_edit(made, tmp_path, monkeypatch):
    later = time.time_ns() + 3 * 10**9
    os.utime(tmp_path / "avatar.npz", ns=(later, later))
    monkeypatch.setattr("carigs.runs.contents.content_digest", lambda path: pytest.fail("read"))
    assert outdated(made) == {}


def test_an_output_that_was_made_again_marks_what_was_made_from_it(made):
    run(made["path"], "other")
    assert outdated(made) == {"train": "made from other inputs"}
    run(made["path"])
    assert outdated(made) == {}


def test_a_job_that_fails_or_is_killed_is_not_finished(made):
    with pytest.raises(RuntimeError), recorded_job(made["train"]):
        raise RuntimeError
    assert outdated(made) == {"train": "not finished"}
    run(made["train"])
    assert outdated(made) == {}


@pytest.mark.parametrize(
    "change",
    [
        lambda job: with_plan(job, settings="t"),
        lambda job: with_plan(job, code="d"),
        lambda job: with_plan(job, packages={"numpy": "3.0"}),
        lambda job: with_plan(job, outside={"anna": "new"}),
        lambda job: replace(job, params={}),
        lambda job: replace(job, inputs=()),
    ],
)
def test_the_key_of_what_a_killed_job_leaves_changes_with_all_that_the_record_compares(made, change):
    assert run(change(made["train"])) != run(made["train"]) == run(made["train"])


def test_the_key_changes_with_the_contents_of_inputs(made):
    before = run(made["train"])
    run(made["path"], "other")
    assert run(made["train"]) != before


def test_jobs_that_failed_since_a_time_are_listed_in_order(made, tmp_path):
    start, log = time.time() - 1, tmp_path / "log"
    assert unfinished_jobs(log, start) == []
    for stage in ("render", "train"):
        with pytest.raises(CarigsError), recorded_job(made[stage]):
            raise CarigsError("no such image")
        os.utime(log / stage / "all.json", (start + 2, start + (1 if stage == "render" else 2)))
    assert unfinished_jobs(log, start) == [log / "render/all.log", log / "train/all.log"]
    assert unfinished_jobs(log, start + 1.5) == [log / "train/all.log"]
    assert unfinished_jobs(tmp_path / "nothing", start) == []


def test_times_of_steps_are_those_of_the_job_alone_and_leave_out_the_first(planned, tmp_path, monkeypatch):
    clock = iter([0, 50, 100, 120, 200, 201, 300, 303])  # begin and end of each step
    monkeypatch.setattr("carigs.runs.lap_times.time", SimpleNamespace(perf_counter=lambda: next(clock)))

    def step(count: int) -> Callable:
        for _ in range(count):
            with timed("frame"):
                pass

    step(1)  # before the job
    with recorded_job(planned["path"]):
        step(3)
    assert job_costs(tmp_path / "log")["path", "all"].steps == {"frame": 2}
