"""What made the outputs of a job: a JSON file beside its log, which stays with the results when they are copied.

Snakemake keeps such notes in `.snakemake`, which belongs to the working folder. It does not look at what results
contain. A record does both: it holds the plan, the parameters and the digests of the inputs and outputs of the job.
"""

from __future__ import annotations

import json
import os
import shutil
import sys
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from carigs.errors import InputError
from carigs.readers.json_files import json_field, read_json
from carigs.runs.contents import content_digest, contents_of, is_unchanged, text_digest
from carigs.runs.lap_times import forget_times, mean_times
from carigs.runs.locks import job_lock
from carigs.runs.planned_job import PlannedJob
from carigs.system.files import write_json

MADE_FROM = ("plan", "params", "inputs")
"""What a record compares: equal values make equal outputs."""


class JobCosts(NamedTuple):
    """What a job has cost."""

    seconds: float
    """Wall time."""
    cpu_seconds: float
    """Processor time of all threads."""
    peak_memory_mb: float | None
    """Largest resident size of the process; None where the operating system does not count it."""
    steps: Mapping[str, float] = MappingProxyType({})
    """Mean wall time of the steps that the stage measures (`carigs.runs.lap_times`)."""


Costs = Mapping[tuple[str, str], JobCosts]
"""Costs of jobs by stage and name of the log without suffix."""


@contextmanager
def recorded_job(job: PlannedJob) -> Iterator[str]:
    """Hold the lock of a job while it runs, and record at its end what made its outputs.

    The record lists the outputs alone until the job is complete. Then it also says what the job has cost: wall time,
    CPU time, the largest resident size of its process, and the mean time of the steps that the stage measures. (The
    directive `benchmark:` of Snakemake would measure the process that waits for the fork server.)

    Args:
        job: The job.

    Yields:
        Digest of all that the outputs depend on: the key of what an earlier run of the job may have left unfinished.

    Raises:
        CarigsError: Another process runs the same job.
    """
    log = Path(job.log)
    file = log.with_suffix(".json")
    with job_lock(log.with_suffix(".lock")):
        if file.is_dir():
            shutil.rmtree(file)
        write_json(file, {"finished": None, "outputs": dict.fromkeys(job.outputs)})
        inputs = _digests(job.inputs, log.parents[1])
        made_from = {"plan": job.plan, "params": dict(job.params), "inputs": inputs}
        forget_times()
        started = _costs()
        yield text_digest(json.dumps(made_from, sort_keys=True))
        seconds, cpu_seconds = (after - before for after, before in zip(_costs(), started, strict=True))
        outputs = {path: contents_of(Path(path)) for path in job.outputs}
        costs = {"seconds": seconds, "cpu_seconds": cpu_seconds, "peak_memory_mb": _peak_memory_mb()}
        costs["steps"] = mean_times()
        write_json(file, {"finished": time.time_ns(), **made_from, "outputs": outputs, "costs": costs})


def read_record(job: PlannedJob) -> dict[str, Any] | None:
    """Read the record of a job.

    Args:
        job: The job.

    Returns:
        The record. None if there is none, if it is damaged, or if an earlier version of carigs has written it: then
        nothing is known of the outputs.
    """
    return _read(Path(job.log).with_suffix(".json"))


def unfinished_jobs(folder: Path, since: float) -> list[Path]:
    """List the jobs that began and did not end.

    Args:
        folder: The study's folder of logs and records, `results/{study}/log`.
        since: Time in seconds since 1970; jobs that began before are left out.

    Returns:
        The log file of each, in the order in which they began.
    """
    began = {file: file.stat().st_mtime for file, record in _read_records(folder).items() if not record["finished"]}
    return [file.with_suffix(".log") for file in sorted(began, key=began.get) if began[file] >= since]


def job_costs(folder: Path) -> dict[tuple[str, str], JobCosts]:
    """Read what the jobs of a study have cost.

    Args:
        folder: The study's folder of logs and records, `results/{study}/log`.

    Returns:
        The costs of each finished job whose record has them, by stage and name of the log without suffix.
    """
    found = {}
    for file, record in _read_records(folder).items():
        if record["finished"] and "costs" in record:
            with suppress(InputError):  # a record that somebody has edited: its costs are not known
                found[file.parent.name, file.stem] = _read_costs(record, file)
    return found


def _read_costs(record: dict[str, Any], file: Path) -> JobCosts:
    costs = json_field(record, "costs", dict, file=file)
    kinds = {"seconds": float, "cpu_seconds": float, "peak_memory_mb": float}
    if costs.get("peak_memory_mb") is None:
        del kinds["peak_memory_mb"]
    values = {key: json_field(costs, key, kind, file=file, where="costs") for key, kind in kinds.items()}
    steps = json_field(costs, "steps", dict, file=file, where="costs") if "steps" in costs else {}
    steps = {step: json_field(steps, step, float, file=file, where="costs.steps") for step in steps}
    return JobCosts(**{"peak_memory_mb": None, **values}, steps=steps)


def _costs() -> tuple[float, float]:
    """Wall and CPU time, of all threads and finished child processes."""
    times = os.times()
    return times.elapsed, times.user + times.system + times.children_user + times.children_system


def _peak_memory_mb() -> float | None:
    """Largest resident size of this process so far; None where the operating system does not count it."""
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def _digests(inputs: Iterable[str], folder: Path) -> dict[str, str]:
    """Digests of inputs. Those that are as the jobs of the study have written them are not read."""
    finished = (record for record in _read_records(folder).values() if record["finished"])
    made = {path: contents for record in finished for path, contents in record["outputs"].items()}
    return {
        path: made[path]["digest"]
        if path in made and is_unchanged(Path(path), made[path])
        else content_digest(Path(path))
        for path in inputs
    }


def _read_records(folder: Path) -> dict[Path, dict[str, Any]]:
    files = (file for file in sorted(folder.glob("*/*.json")) if not file.name.startswith("."))
    return {file: record for file in files if (record := _read(file)) is not None}


def _read(file: Path) -> dict[str, Any] | None:
    """A record with all fields that its readers use."""
    try:
        record = read_json(file, dict)
    except InputError:
        return None
    outputs, finished = record.get("outputs"), record.get("finished")
    if not isinstance(outputs, dict) or "finished" not in record:
        return None
    if finished is not None:
        if not isinstance(finished, int) or not all(isinstance(record.get(part), dict) for part in MADE_FROM):
            return None
        texts = ("digest", "state")
        if not all(
            isinstance(made, dict) and all(isinstance(made.get(k), str) for k in texts) for made in outputs.values()
        ):
            return None
    return record
