"""The plan of a study, and what a run says of it."""

import subprocess
import sys

import pytest

from carigs.planning.job_graph import Job
from carigs.planning.study_plan import ANNOUNCED_SECONDS, announcement, duration, plan_study


def train(iterations, variants=1, cores=1):
    """A study of trainings of the toy that do not wait for each other."""
    jobs = [
        Job(n, "train", {"subject": "toy", "variant": "surfhead"}, 1, 0.0, 0.0, False, None, ())
        for n in range(variants)
    ]
    return plan_study(jobs, {"toy": [f"train.iterations={iterations}"]}, 1, cores)


@pytest.fixture(autouse=True)
def empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def test_a_short_run_says_nothing_and_a_long_one_how_long_it_takes():
    assert announcement(train(10)) is None
    plan = train(1_000_000, variants=2, cores=1)
    assert (
        plan.schedule.makespan == pytest.approx(sum(plan.seconds.values()))
        and plan.schedule.makespan > ANNOUNCED_SECONDS
    )
    line = announcement(plan)
    assert f"about {duration(plan.schedule.makespan)} on 1 core, 100 % of it train" in line and "factor of 2" in line
    assert "on 2 cores" in announcement(train(1_000_000, variants=2, cores=2))


def test_nothing_to_do_is_not_announced():
    assert announcement(plan_study([], {"toy": []}, 1, 2)) is None


def test_data_that_are_not_here_are_said_to_be_assumed():
    jobs = [Job(0, "train", {"subject": "own", "variant": "surfhead"}, 1, 0.0, 0.0, False, None, ())]
    own = ["study=own", "capture.folder=none", "capture.head_model=none.npz", "train.iterations=100000"]
    assert "the data are not here: within a factor of 3" in announcement(plan_study(jobs, {"own": own}, 1, 2))


@pytest.mark.parametrize(("seconds", "text"), [(5, "5.0 s"), (120, "2.0 min"), (7200, "2.0 h")])
def test_durations_are_readable(seconds, text):
    assert duration(seconds) == text


def test_a_job_has_the_costs_of_its_own_study():
    """Ten times the steps in one of two studies."""
    few, many = (Job(n, "train", {"study": name, "subject": "toy", "variant": "surfhead"}, 1, 0.0, 0.0, False, None, ())
                 for n, name in enumerate(("few", "many")))  # fmt: skip
    studies = {"few": ["train.iterations=10000"], "many": ["train.iterations=100000"]}
    seconds = plan_study([few, many], studies, 1, 1).seconds
    assert 8 < seconds[1] / seconds[0] < 10


def test_a_run_starts_without_what_reads_captures_and_videos():
    """They take half a second to import."""
    code = (
        "import sys\n"
        "from carigs.planning.study_plan import plan_study\n"
        "assert plan_study([], {'toy': []}, 1, 2).footage\n"
        "print([m for m in ('numba', 'cv2', 'scipy', 'pandas') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
