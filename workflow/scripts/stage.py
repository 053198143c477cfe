"""Run the stage named like the rule: inputs, outputs and parameters are its keywords, its messages go to the log."""

import sys

from carigs.fork_server import run_in_fork

WORKFLOW_ONLY = ("settings", "watch", "watch_targets", "code", "outside")
"""Inputs and parameters of the rule that are not keywords of the stage."""


def _job(job) -> dict:
    """The arguments of `carigs.stages.job.run_job`, as JSON can hold them."""
    files = {**job.input, **job.output}
    return dict(
        stage=job.rule,
        settings=files["settings"],
        files={
            name: files_ if isinstance(files_, str) else [*files_]
            for name, files_ in files.items()
            if name not in WORKFLOW_ONLY
        },
        params={name: value for name, value in job.params.items() if name not in WORKFLOW_ONLY},
        code=job.params.code,
        inputs=[*job.input],
        outputs=[*job.output],
        outside=dict(job.params.get("outside", {})),
        log=job.log[0],
    )


sys.exit(run_in_fork("carigs.stages.job:run_job", _job(snakemake)))  # noqa: F821 (Snakemake defines it)
