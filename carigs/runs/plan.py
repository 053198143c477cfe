"""What a job is planned with: its settings, the code and packages that it runs, and the files that its settings name.

Snakemake compares this plan with that of an earlier run through the parameter `plan` of a rule; the record of a job
keeps it with the results (`carigs.runs.job_record`).
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Sequence
from dataclasses import asdict
from functools import cache
from typing import Any

from omegaconf import OmegaConf

from carigs.config import compose
from carigs.runs.contents import text_digest
from carigs.runs.outside_files import files_digest, outside_files
from carigs.runs.planned_job import Plan
from carigs.runs.sources import fingerprint, newest_source, package_versions

PLANNED_AT = "CARIGS_PLANNED_AT"
"""Environment variable with the time of planning, in nanoseconds since 1970."""
TOY = ("carigs.toy",)
"""Code that draws the toy: it makes no result of other subjects."""


def job_plan(stage: str, overrides: Sequence[str], level: float | None = None) -> Plan:
    """Plan a job of a stage.

    Args:
        stage: Name of the stage.
        overrides: Hydra overrides of the study and of the job, such as `subject=toy`.
        level: Exaggeration level of the job, if it has one.

    Returns:
        The plan. Jobs of a subject depend on the files of its capture, whichever stage reads them.

    Raises:
        SettingsError: For wrong settings.
    """
    settings = compose(*overrides)
    of_subject = any(override.startswith("subject=") for override in overrides)
    named = outside_files("capture", settings.capture) if of_subject else {}
    named |= outside_files(stage, settings[stage], level)
    without = TOY if of_subject and settings.capture.source != "toy" else ()
    code, packages = _code_and_packages(f"carigs.stages.{stage}", without)
    return Plan(
        settings=settings_digest(stage, settings[stage]),
        code=code,
        packages=packages,
        outside={str(path): _digest(path) for path in named.values()},
    )


def name_time_of_planning() -> None:
    """Let the jobs of this run know when it began to plan."""
    os.environ[PLANNED_AT] = str(time.time_ns())


def code_is_planned(stage: str, code: str) -> bool:
    """Whether the code of a stage is still what its job was planned with.

    Args:
        stage: Name of the stage.
        code: `Plan.code`.

    Returns:
        False if a file that the stage depends on was edited since the run was planned. Sources are read only if a file
        of the project is newer than the plan.
    """
    planned_at = os.environ.get(PLANNED_AT, "")
    if planned_at.isdecimal() and newest_source() < int(planned_at):
        return True
    return code in {fingerprint(f"carigs.stages.{stage}", without) for without in ((), TOY)}


def settings_digest(stage: str, section: Any) -> str:
    """Digest of a section.

    Args:
        stage: Name of the section.
        section: The section, as its dataclass or as OmegaConf's mapping.

    Returns:
        Hexadecimal digits.
    """
    values = OmegaConf.to_container(section, resolve=True) if OmegaConf.is_config(section) else asdict(section)
    return text_digest(json.dumps(values, sort_keys=True))


_digest = cache(files_digest)


@cache
def _code_and_packages(module: str, without: tuple[str, ...]) -> tuple[str, dict[str, str]]:
    return fingerprint(module, without), package_versions(module, without)
