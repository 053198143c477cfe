"""Seconds of jobs: the table, and times of an earlier run."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from carigs.config import compose
from carigs.planning.costs import all_seconds, earlier_times, job_bytes, job_seconds
from carigs.planning.footage import ASSUMED, Footage, subject_footage
from carigs.planning.job_graph import Job
from carigs.planning.schedule import list_schedule

TOY = {"toy": Footage(216, 27, 27, 9, 208 * 272 / 1e6, "counted")}
RUN = json.loads(Path(__file__).with_name("toy_run.json").read_text())
JOBS = [
    Job(n, rule, w, threads, mb, p, local, f"{n}.log", tuple(needs))
    for n, rule, w, threads, mb, p, local, needs, _ in RUN["jobs"]
]
STEPS = ("train.iterations=3000",)  # of the run that was recorded
MEASURED = {row[0]: row[-1] for row in RUN["jobs"]}


@pytest.fixture(scope="module")
def table():
    """Seconds of the jobs by the table of costs."""
    return {job.number: job_seconds(job, TOY, STEPS) for job in JOBS}


def first(rule):
    return next(job for job in JOBS if job.rule == rule)


def test_the_table_predicts_the_toy_study_on_the_machine_where_it_was_measured(table):
    seconds = all_seconds(JOBS, table, {}, 1.0)
    assert list_schedule(JOBS, seconds, 1, 2).makespan == pytest.approx(RUN["makespan"], rel=0.25)


def test_costs_grow_with_steps_and_pixels():
    train, large = first("train"), {"toy": replace(TOY["toy"], megapixels=4 * TOY["toy"].megapixels)}
    few, many = (job_seconds(train, TOY, (f"train.iterations={n}",)) for n in (1000, 9000))
    assert 5 < many / few < 9  # the start of a job does not grow
    for rule in ("capture", "gtstar", "train", "render", "metrics"):
        assert job_seconds(first(rule), large, ()) > 1.4 * job_seconds(first(rule), TOY, ())
    for rule in ("capture", "gtstar", "render"):
        assert job_bytes(first(rule), large, ()) == pytest.approx(4 * job_bytes(first(rule), TOY, ()), rel=0.05)


def test_a_budget_of_a_training_is_its_time():
    train = first("train")
    short, long = (job_seconds(train, TOY, (f"train.budget={n}min",)) for n in (1, 3))
    assert long - short == pytest.approx(120)
    assert job_seconds(train, TOY, ("train.budget=1min", "train.iterations=9")) == short


def test_edits_by_a_network_cost_by_their_number_and_steps():
    train = first("train")

    def edits(*overrides):
        return job_seconds(train, TOY, (*STEPS, *overrides)) - job_seconds(train, TOY, STEPS)

    network = "train.edit.editor=instruct_pix2pix"
    assert 3600 < edits(network) < 100 * 3600  # without a GPU: 120 edits of ten minutes
    twice = edits(network, "train.edit.every=5") / edits(network)
    assert twice == pytest.approx(2, rel=0.01)
    assert edits(network, "train.edit.steps=10") < 0.6 * edits(network)
    assert 0 < edits("train.edit.editor=drawn_nose") < 30
    assert edits("train.edit.every=1") == 0


def test_times_of_an_earlier_run_count_first_and_correct_the_others(table, tmp_path):
    trains = [job for job in JOBS if job.rule == "train"]
    record = {"log": [trains[0].log], "starttime": 100.0, "endtime": 350.0}
    (tmp_path / "one").write_text(json.dumps(record))
    (tmp_path / "unfinished").write_text(json.dumps({**record, "log": [trains[1].log], "incomplete": True}))
    (tmp_path / "foreign").write_text(json.dumps({**record, "log": ["elsewhere.log"]}))
    (tmp_path / "broken").write_text('{"log": ')
    (tmp_path / "empty").write_text("{}")
    earlier = earlier_times(JOBS, tmp_path)
    assert earlier == {trains[0].number: 250.0}
    seconds = all_seconds(JOBS, table, earlier, 3.0)
    assert seconds[trains[0].number] == 250
    assert seconds[trains[1].number] == pytest.approx(250 * table[trains[1].number] / table[trains[0].number])
    assert seconds[first("render").number] == pytest.approx(3 * table[first("render").number])


def test_no_records_are_no_times(tmp_path):
    assert earlier_times(JOBS, tmp_path / "missing") == {}


def test_footage_from_settings_from_a_folder_and_assumed(tmp_path):
    toy = subject_footage(compose(), tmp_path / "none.json")
    assert (toy.train, toy.val, toy.test, toy.cameras, toy.megapixels) == (216, 27, 27, 9, 208 * 272 / 1e6)
    folder = f"capture.source=folder capture.folder={tmp_path} capture.head_model=m.npz".split()
    capture = compose(*folder)
    assert subject_footage(capture, tmp_path / "none.json") == ASSUMED
    for split, count in (("train", 6), ("val", 2), ("test", 3)):
        frames = [{"w": 300, "h": 200, "camera_index": i % 2} for i in range(count)]
        (tmp_path / f"transforms_{split}.json").write_text(json.dumps({"frames": frames}))
    counted = subject_footage(capture, tmp_path / "none.json")
    assert (counted.train, counted.val, counted.test, counted.cameras, counted.megapixels) == (6, 2, 3, 2, 0.06)
    capture = compose(*folder, "capture.stride=2", "capture.max_frames=2")
    thinned = subject_footage(capture, tmp_path / "none.json")
    assert (thinned.train, thinned.val, thinned.test) == (2, 1, 2)


def test_frames_that_are_not_rendered_cost_nothing():
    images = Footage(100, 50, 2400, 16, 0.4, "counted")
    assert images.rendered(0.25, None) == 2400 and images.rendered(0, None) == 2450
    assert images.rendered(0.25, 16) == 256 and images.rendered(0.25, 999) == 2400


def test_one_slow_job_does_not_make_its_rule_slow():
    """A job that did not run before gets the median of its rule's ratios: an outlier is one in three."""
    jobs = [Job(n, "train", {}, 1, 0.0, 0.0, False, None, ()) for n in range(4)]
    table, earlier = dict.fromkeys(range(4), 10.0), {0: 10.0, 1: 20.0, 2: 900.0}
    assert all_seconds(jobs, table, earlier, 7.0) == earlier | {3: 20.0}
