"""A list schedule: every job starts on the first node with room for it, as soon as what it needs is done."""

from __future__ import annotations

import heapq
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from carigs.errors import SettingsError
from carigs.planning.job_graph import Job


@dataclass(frozen=True)
class JobSchedule:
    """When jobs run."""

    start: dict[int, float]
    """Seconds from the beginning at which each job starts, by its number."""
    makespan: float
    """Seconds until the last job is done."""
    peak_memory: float
    """Largest sum of what the jobs on one node request at a time, in MB."""


def list_schedule(
    jobs: Sequence[Job], seconds: Mapping[int, float], nodes: int, cores: int, memory: float = float("inf")
) -> JobSchedule:
    """Simulate a run.

    Among the jobs that could start, those of higher priority come first, then those with the longest way to the end.
    Local jobs need no room on a node. By a theorem of Graham no list schedule takes longer than twice the best one if
    jobs have one thread each; Snakemake's own order differs, and that is the error of this simulation.

    Args:
        jobs: The jobs.
        seconds: Duration of each job by its number.
        nodes: Number of nodes.
        cores: Cores of each node.
        memory: Memory of each node in MB.

    Returns:
        The schedule.

    Raises:
        SettingsError: If a job fits on no node.
    """
    for job in jobs:
        if not job.is_local and (job.threads > cores or job.memory > memory):
            needed = f"{job.threads} cores and {job.memory:g} MB"
            raise SettingsError(f"a job of the rule {job.rule} needs {needed}; a node has {cores} and {memory:g} MB")
    remaining = path_lengths(jobs, seconds)
    followers: dict[int, list[Job]] = {job.number: [] for job in jobs}
    for job in jobs:
        for number in job.needs:
            followers[number].append(job)
    waiting = {job.number: len(job.needs) for job in jobs}
    ready = [job for job in jobs if not job.needs]
    running: list[tuple[float, int, int, Job]] = []
    free_cores, free_memory = [cores] * nodes, [memory] * nodes
    start: dict[int, float] = {}
    now = peak = 0.0
    while ready or running:
        ready.sort(key=lambda job: (-job.priority, -remaining[job.number], job.number))
        held = []
        for job in ready:
            node = next(
                (n for n in range(nodes) if free_cores[n] >= job.threads and free_memory[n] >= job.memory), None
            )  # fmt: skip
            if job.is_local:
                node = -1
            elif node is None:
                held.append(job)
                continue
            else:
                free_cores[node] -= job.threads
                free_memory[node] -= job.memory
            start[job.number] = now
            heapq.heappush(running, (now + seconds[job.number], job.number, node, job))
        ready = held
        on_node = [sum(job.memory for _, _, n, job in running if n == node) for node in range(nodes)]
        peak = max(peak, *on_node)
        now = running[0][0]
        while running and running[0][0] <= now:
            _, number, node, job = heapq.heappop(running)
            if node >= 0:
                free_cores[node] += job.threads
                free_memory[node] += job.memory
            for follower in followers[number]:
                waiting[follower.number] -= 1
                if waiting[follower.number] == 0:
                    ready.append(follower)
    return JobSchedule(start, now, peak)


def path_lengths(jobs: Sequence[Job], seconds: Mapping[int, float]) -> dict[int, float]:
    """Seconds from the start of each job to the end of the last one that waits for it, on unlimited nodes.

    Args:
        jobs: The jobs, each after the ones that it needs.
        seconds: Duration of each job by its number.

    Returns:
        Seconds by number of the job, its own included.
    """
    after = dict.fromkeys((job.number for job in jobs), 0.0)
    lengths = {}
    for job in reversed(jobs):
        lengths[job.number] = seconds[job.number] + after[job.number]
        for number in job.needs:
            after[number] = max(after[number], lengths[job.number])
    return lengths


def critical_path(jobs: Sequence[Job], seconds: Mapping[int, float]) -> list[Job]:
    """The chain of jobs that takes longest: no number of nodes makes the study faster.

    Args:
        jobs: The jobs, each after the ones that it needs.
        seconds: Duration of each job by its number.

    Returns:
        The chain in the order of execution.
    """
    lengths, by_number = path_lengths(jobs, seconds), {job.number: job for job in jobs}
    followers: dict[int, list[int]] = {number: [] for number in by_number}
    for job in jobs:
        for number in job.needs:
            followers[number].append(job.number)
    chain, choices = [], [job.number for job in jobs if not job.needs]
    while choices:
        chain.append(by_number[max(choices, key=lambda number: lengths[number])])
        choices = followers[chain[-1].number]
    return chain
