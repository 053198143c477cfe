"""The plan of a study: what every job costs, and how long all of them take."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from carigs.config import compose, compose_study
from carigs.planning.costs import REFERENCE_SPEED, all_seconds, earlier_times, job_bytes, job_seconds, speed_test
from carigs.planning.footage import Footage, subject_footage
from carigs.planning.job_graph import Job
from carigs.planning.schedule import JobSchedule, list_schedule

ANNOUNCED_SECONDS = 180.0
"""A run that is expected to take longer says so when it starts."""


@dataclass(frozen=True)
class StudyPlan:
    """A study before it starts. Mappings of jobs have their numbers as keys."""

    nodes: int
    cores: int
    """Of each node."""
    jobs: Sequence[Job]
    footage: Mapping[tuple[str, str], Footage]
    """By study and subject."""
    speed: float
    """Of this machine, relative to the one that the table of costs was measured on."""
    earlier: Mapping[int, float]
    """Seconds of the jobs that ran in this directory before."""
    seconds: Mapping[int, float]
    """Of every job."""
    sizes: Mapping[int, float]
    """Bytes that each job writes."""
    schedule: JobSchedule


def plan_study(
    jobs: Sequence[Job],
    studies: Mapping[str, Sequence[str]],
    nodes: int,
    cores: int,
    memory: float = float("inf"),
) -> StudyPlan:
    """Estimate the jobs of studies in the current directory, and simulate the run.

    Args:
        jobs: The jobs.
        studies: Hydra overrides of each study, by its folder. Jobs of no study are taken for jobs of the first.
        nodes: Number of nodes.
        cores: Cores of each node.
        memory: Memory of each node in MB.

    Returns:
        The plan.

    Raises:
        SettingsError: If a job fits on no node.
    """
    footage = {
        study: {
            subject: subject_footage(
                compose(*overrides, f"subject={subject}"), Path("results") / study / subject / "capture.json"
            )
            for subject in compose_study(*overrides).study.subjects
        }
        for study, overrides in studies.items()
    }
    first = next(iter(studies))
    known = {}
    for job in jobs:
        study = job.wildcards.get("study", first)
        known[job.number] = (job, footage[study], studies[study])
    earlier = earlier_times(jobs, Path(".snakemake/metadata"))
    speed = speed_test() / REFERENCE_SPEED
    seconds = all_seconds(jobs, {number: job_seconds(*job) for number, job in known.items()}, earlier, speed)
    return StudyPlan(
        nodes=nodes,
        cores=cores,
        jobs=jobs,
        footage={(study, name): images for study in footage for name, images in footage[study].items()},
        speed=speed,
        earlier=earlier,
        seconds=seconds,
        sizes={number: job_bytes(*job) for number, job in known.items()},
        schedule=list_schedule(jobs, seconds, nodes, cores, memory),
    )


def announcement(plan: StudyPlan) -> str | None:
    """What a run says of its duration when it starts.

    Args:
        plan: The plan of the jobs that will run.

    Returns:
        One line; None if the run takes less than `ANNOUNCED_SECONDS`.
    """
    total = plan.schedule.makespan
    if total < ANNOUNCED_SECONDS:
        return None
    by_rule = {rule: 0.0 for rule in dict.fromkeys(job.rule for job in plan.jobs)}
    for job in plan.jobs:
        by_rule[job.rule] += plan.seconds[job.number] * job.threads
    largest = max(by_rule, key=lambda rule: by_rule[rule])
    share = by_rule[largest] / sum(by_rule.values())
    cores = f"{plan.cores} core{'s' * (plan.cores > 1)}"
    return f"this takes about {duration(total)} on {cores}, {100 * share:.0f} % of it {largest}; {uncertainty(plan)}"


def uncertainty(plan: StudyPlan) -> str:
    """Say where the times of a plan come from, and how far off they may be.

    Args:
        plan: The plan.

    Returns:
        A part of a sentence.
    """
    if all(job.number in plan.earlier for job in plan.jobs if not job.is_local):
        return "all jobs ran here before: expect 25 %"
    if any("assumed" in images.source for images in plan.footage.values()):
        return "the data are not here: within a factor of 3"
    return f"times from the table of costs x {plan.speed:.2f} for this machine: within a factor of 2"


def duration(seconds: float) -> str:
    """Show a duration in a readable unit.

    Args:
        seconds: The duration.

    Returns:
        Seconds, minutes or hours.
    """
    if seconds < 100:
        return f"{seconds:.1f} s"
    return f"{seconds / 60:.1f} min" if seconds < 6000 else f"{seconds / 3600:.1f} h"
