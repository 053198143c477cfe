"""The simulated schedule."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from carigs.errors import SettingsError
from carigs.planning.job_graph import Job
from carigs.planning.schedule import critical_path, list_schedule, path_lengths


def job(number, needs=(), threads=1, memory=100.0, priority=0.0, is_local=False, rule="train"):
    return Job(number, rule, {}, threads, memory, priority, is_local, None, tuple(needs))


@st.composite
def studies(draw):
    count = draw(st.integers(1, 25))
    needs = [draw(st.sets(st.integers(0, n - 1), max_size=3)) if n else set() for n in range(count)]
    jobs = [
        job(n, sorted(needs[n]), threads=draw(st.integers(1, 3)), priority=draw(st.integers(0, 1)))
        for n in range(count)
    ]
    return jobs, {n: float(draw(st.integers(0, 50))) for n in range(count)}


@given(study=studies(), nodes=st.integers(1, 4), cores=st.integers(3, 6))
def test_jobs_wait_for_what_they_need_and_fit_on_the_nodes(study, nodes, cores):
    jobs, seconds = study
    schedule = list_schedule(jobs, seconds, nodes, cores)
    for each in jobs:
        for other in each.needs:
            assert schedule.start[each.number] >= schedule.start[other] + seconds[other]
    for now in schedule.start.values():
        busy = [j for j in jobs if schedule.start[j.number] <= now < schedule.start[j.number] + seconds[j.number]]
        assert sum(j.threads for j in busy) <= nodes * cores
    work = sum(seconds[j.number] * j.threads for j in jobs)
    path = sum(seconds[j.number] for j in critical_path(jobs, seconds))
    assert schedule.makespan >= max(path, work / (nodes * cores)) - 1e-9
    assert schedule.makespan <= sum(seconds.values())


@given(study=studies())
def test_on_many_nodes_the_critical_path_remains(study):
    jobs, seconds = study
    path = sum(seconds[j.number] for j in critical_path(jobs, seconds))
    assert list_schedule(jobs, seconds, 30, 3).makespan == path == max(path_lengths(jobs, seconds).values())


@given(study=studies(), cores=st.integers(1, 4))
def test_no_schedule_of_single_threads_is_twice_as_long_as_the_best(study, cores):
    """Graham (1966): work / cores + (1 - 1 / cores) critical path bounds every list schedule."""
    jobs = [job(j.number, j.needs) for j in study[0]]
    seconds = study[1]
    path = sum(seconds[j.number] for j in critical_path(jobs, seconds))
    bound = sum(seconds.values()) / cores + (1 - 1 / cores) * path
    assert list_schedule(jobs, seconds, 1, cores).makespan <= bound + 1e-9


def test_memory_limits_what_runs_side_by_side():
    jobs, seconds = [job(n, memory=600.0) for n in range(4)], dict.fromkeys(range(4), 10.0)
    assert list_schedule(jobs, seconds, 1, 4).makespan == 10
    tight = list_schedule(jobs, seconds, 1, 4, memory=1000)
    assert (tight.makespan, tight.peak_memory) == (40, 600)


def test_local_jobs_need_no_node():
    jobs = [job(0), job(1, is_local=True)]
    assert list_schedule(jobs, {0: 5.0, 1: 5.0}, 1, 1).makespan == 5


@pytest.mark.parametrize("large", [job(0, threads=3), job(0, memory=5000.0)])
def test_a_job_that_fits_nowhere_is_named(large):
    with pytest.raises(SettingsError, match="a job of the rule train needs"):
        list_schedule([large], {0: 1.0}, 4, 2, memory=4000)


def test_a_real_run_of_the_toy_study_took_as_long_as_the_simulation():
    run = json.loads(Path(__file__).with_name("toy_run.json").read_text())
    jobs = [
        Job(n, rule, w, threads, mb, p, local, None, tuple(needs))
        for n, rule, w, threads, mb, p, local, needs, _ in run["jobs"]
    ]
    seconds = {row[0]: row[-1] for row in run["jobs"]}
    assert list_schedule(jobs, seconds, 1, 2).makespan == pytest.approx(run["makespan"], rel=0.25)
