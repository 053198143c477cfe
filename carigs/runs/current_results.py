"""Which results are current: those whose record has the plan, the parameters and the inputs of today, undamaged."""

from __future__ import annotations

import json
from collections.abc import Collection, Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from carigs.runs.contents import is_unchanged
from carigs.runs.job_record import read_record
from carigs.runs.planned_job import PlannedJob


class Difference(NamedTuple):
    """Why results are made again."""

    reason: str
    trigger: str
    """The trigger of Snakemake that it corresponds to: an option of the command line can switch it off. Empty for
    results that are not complete or not known."""


def outdated_jobs(
    jobs: Iterable[PlannedJob], digests: Mapping[str, str], triggers: Collection[str]
) -> dict[PlannedJob, str]:
    """Find the jobs whose outputs are to be made again.

    Args:
        jobs: Jobs of the run, each after those whose outputs it reads.
        digests: Digests of inputs that no job of `jobs` makes: of the settings files.
        triggers: Which differences count, as in Snakemake's option `--rerun-triggers`.

    Returns:
        The reason by job. Left out are jobs that have never run and jobs for which the only reason is that a job before
        them is run again: those Snakemake finds itself.
    """
    known, outdated, remade = dict(digests), {}, set()
    for job in jobs:
        record = read_record(job)
        found = _difference(job, record, known, remade)
        if found and (not found.trigger or found.trigger in triggers):
            if record is not None or any(Path(output).exists() for output in job.outputs):
                outdated[job] = found.reason
                remade.update(job.outputs)
        elif record is not None:
            known |= {path: made["digest"] for path, made in record["outputs"].items()}
    return outdated


def _difference(
    job: PlannedJob, record: dict[str, Any] | None, known: Mapping[str, str], remade: Collection[str]
) -> Difference | None:
    if record is None:
        return Difference("made by a job of which no record can be read", "")
    if not record["finished"]:
        return Difference("not finished", "")
    plan = record["plan"]
    if plan.get("settings") != job.plan["settings"] or record["params"] != json.loads(json.dumps(dict(job.params))):
        return Difference("made with other settings", "params")
    if plan.get("code") != job.plan["code"]:
        return Difference("made with other code", "params")
    if changed := _changed(plan.get("packages"), job.plan["packages"]):
        return Difference(f"made with another version of {', '.join(changed)}", "software-env")
    if record["inputs"].keys() != set(job.inputs):
        return Difference("made from other inputs", "input")
    if any(path not in remade and known.get(path) != digest for path, digest in record["inputs"].items()):
        return Difference("made from other inputs", "mtime")
    if changed := _changed(plan.get("outside"), job.plan["outside"], may_be_gone=True):
        return Difference(f"made from another state of {', '.join(changed)}", "mtime")
    if record["outputs"].keys() != set(job.outputs):
        return Difference("made by a job with other outputs", "")
    if not all(is_unchanged(Path(path), made) for path, made in record["outputs"].items()):
        return Difference("changed or damaged since", "mtime")
    return None


def _changed(before: Any, now: Mapping[str, str], may_be_gone: bool = False) -> list[str]:
    """Names with another value than before. Results can be used where the files that they were made from are not."""
    before = before if isinstance(before, dict) else {}
    return [
        name
        for name in sorted(before.keys() | now.keys())
        if before.get(name) != now.get(name) and not (may_be_gone and now.get(name) == "")
    ]
