"""Run the stage named like the rule: inputs, outputs and parameters are its keywords, its messages go to the log."""

import sys
from dataclasses import asdict

from carigs.runs.planned_job import WORKFLOW_ONLY, planned_job
from carigs.system.fork_server import run_in_fork


def _arguments(job) -> dict:
    """The arguments of `carigs.stages.job.run_job`, as JSON can hold them."""
    files = {name: files for name, files in {**job.input, **job.output}.items() if name not in WORKFLOW_ONLY}
    return dict(
        settings=job.input.settings,
        files={name: found if isinstance(found, str) else [*found] for name, found in files.items()},
        job=asdict(planned_job(job)),
        threads=job.threads,
    )


sys.exit(run_in_fork("carigs.stages.job:run_job", _arguments(snakemake)))  # noqa: F821 (Snakemake defines it)
