"""A job of the workflow as Snakemake plans it. Scripts of jobs import this module, so it imports little."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypedDict

WORKFLOW_ONLY = ("settings", "watch", "watch_targets", "plan")
"""Inputs and parameters of a rule that are not keywords of its stage."""


class Plan(TypedDict):
    """What decides what a job makes, besides its inputs and parameters."""

    settings: str
    """Digest of the section of the stage."""
    code: str
    """Fingerprint of the stage (`carigs.runs.sources`)."""
    packages: dict[str, str]
    """Versions of the packages that the code uses; empty for optional ones that are not installed."""
    outside: dict[str, str]
    """Digest of each file or folder outside of the study that the settings name; empty for one that is not there."""


@dataclass(frozen=True, eq=False)
class PlannedJob:
    """What a job reads and writes."""

    log: str
    """Log file, `results/{study}/log/{stage}/{point}.log`. The record has the same name and the suffix `.json`."""
    plan: Plan
    params: Mapping[str, Any]
    """Further keywords of the stage."""
    inputs: tuple[str, ...]
    """Files and folders that the job reads, but for its settings: results of other jobs."""
    outputs: tuple[str, ...]
    """Files and folders that the job writes."""

    @property
    def stage(self) -> str:
        """Name of the stage."""
        return Path(self.log).parent.name

    @property
    def study(self) -> Path:
        """Folder of the study."""
        return Path(self.log).parents[2]


def planned_job(job: Any) -> PlannedJob:
    """Describe a job of a stage.

    Args:
        job: Snakemake's job, or the object `snakemake` in a script.

    Returns:
        The same job for its record.
    """
    return PlannedJob(
        log=str(job.log[0]),
        plan=job.params.plan,
        params={name: value for name, value in job.params.items() if name not in WORKFLOW_ONLY},
        inputs=tuple(str(file) for file in job.input if file != job.input.settings),
        outputs=tuple(map(str, job.output)),
    )
