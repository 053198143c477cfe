"""The jobs of a study and what each waits for, as Snakemake sees them.

Snakemake runs in a process of its own: `python -m carigs.planning.job_graph`, with a request on standard input.
"""

from __future__ import annotations

import io
import json
import subprocess
import sys
from collections.abc import Sequence
from contextlib import redirect_stdout
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any

from carigs.errors import SettingsError
from carigs.runs.snakemake_process import check_working_folder, snakemake_environment

if TYPE_CHECKING:
    from snakemake.workflow import Workflow


@dataclass(frozen=True)
class Job:
    """One job of the workflow."""

    number: int
    rule: str
    wildcards: dict[str, str]
    threads: int
    memory: float
    """Memory that the rule requests, in MB."""
    priority: float
    is_local: bool
    """Whether it runs beside Snakemake instead of on a node: small steps such as the settings files."""
    log: str | None
    """File of its log, which names the job across runs."""
    needs: tuple[int, ...]
    """Numbers of the jobs whose outputs it reads."""


def study_jobs(config: Sequence[str], snakefile: str, targets: list[str], cores: int, from_scratch: bool) -> list[Job]:
    """List the jobs of a study.

    Args:
        config: Values of Snakemake's `--config`, as from `carigs.config.snakemake_config`.
        snakefile: The workflow.
        targets: Rules or files to make.
        cores: Cores of a node; jobs with more threads get that many.
        from_scratch: Also list jobs whose outputs are there.

    Returns:
        The jobs, each after the ones that it needs.

    Raises:
        InputError: The current directory cannot be written to.
        SettingsError: If Snakemake cannot plan the study.
    """
    request = {
        "config": [*config],
        "snakefile": snakefile,
        "targets": targets,
        "cores": cores,
        "from_scratch": from_scratch,
    }
    command = [sys.executable, "-m", "carigs.planning.job_graph"]
    check_working_folder()
    surroundings = {"env": snakemake_environment(), "capture_output": True, "text": True}
    done = subprocess.run(command, input=json.dumps(request), **surroundings)
    if done.returncode != 0:
        said = [line.strip() for line in done.stderr.splitlines() if line.strip()]
        raise SettingsError(f"Snakemake cannot plan the study: {said[-1] if said else 'it said nothing'}")
    jobs = json.loads(done.stdout.splitlines()[-1])
    return [Job(**{**job, "needs": tuple(job["needs"])}) for job in jobs]


def _read_jobs(request: dict[str, Any]) -> list[Job]:
    """Have Snakemake build its graph of jobs. Its Python interface returns no jobs, so its internals are read."""
    from pathlib import Path

    from snakemake.api import SnakemakeApi
    from snakemake.cli import parse_config
    from snakemake.settings.enums import Quietness
    from snakemake.settings.types import ConfigSettings, DAGSettings, OutputSettings, ResourceSettings

    with SnakemakeApi(OutputSettings(quiet={Quietness.ALL})) as api:
        workflow = api.workflow(
            resource_settings=ResourceSettings(cores=request["cores"]),
            config_settings=ConfigSettings(config=parse_config(request["config"])),
            snakefile=Path(request["snakefile"]),
        )
        settings = DAGSettings(targets=set(request["targets"]), forceall=request["from_scratch"])
        with redirect_stdout(io.StringIO()):
            workflow.dag(dag_settings=settings).printd3dag()  # the least that builds the graph and runs nothing
        return needed_jobs(workflow._workflow)


def needed_jobs(workflow: Workflow) -> list[Job]:
    """List the jobs that a workflow will run.

    Args:
        workflow: Snakemake's workflow, with its graph of jobs.

    Returns:
        The jobs, each after the ones that it needs.
    """
    graph = workflow.dag
    needed = [job for job in graph.toposorted() for job in sorted(job, key=graph.jobid)]
    needed = [job for job in needed if graph.needrun(job)]
    return [
        Job(
            number=graph.jobid(job),
            rule=job.rule.name,
            wildcards=dict(job.wildcards.items()),
            threads=int(job.threads),
            memory=float(job.resources.get("mem_mb", 0)),
            priority=float(job.rule.priority),
            is_local=job.rule.name in workflow._localrules,
            log=str(job.log[0]) if job.log else None,
            needs=tuple(sorted(graph.jobid(other) for other in graph.dependencies[job] if graph.needrun(other))),
        )
        for job in needed
    ]


if __name__ == "__main__":
    found = _read_jobs(json.load(sys.stdin))
    print(json.dumps([asdict(job) for job in found]))
