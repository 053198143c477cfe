"""One line for each job that a run starts. Snakemake prints about ten, which the file that it keeps has in any case."""

from __future__ import annotations

import logging
import sys


def show_job_lines(logger: logging.Logger, jobs: int) -> None:
    """Let a logger show a line per job, and of its other messages warnings and errors only.

    Args:
        logger: Snakemake's. What it writes to files stays as it is.
        jobs: Number of jobs of the run.
    """
    for handler in logger.handlers:
        if isinstance(handler, logging.StreamHandler) and not isinstance(handler, logging.FileHandler):
            handler.setLevel(logging.WARNING)
    logger.addHandler(_JobLines(jobs))


class _JobLines(logging.Handler):
    """Prints rule and first output of a job when it starts, and how many jobs are done; not for small local steps."""

    def __init__(self, jobs: int):
        super().__init__(logging.INFO)
        self.done, self.jobs = 0, jobs

    def emit(self, record: logging.LogRecord) -> None:
        """Print the line of a record that tells of a job's start.

        Args:
            record: A record of Snakemake's; its attribute `event` says what happened.
        """
        event = getattr(record, "event", None)
        if event == "progress":
            self.done, self.jobs = record.done, record.total
        elif event == "job_info" and not record.local:
            print(f"[{self.done} of {self.jobs} done] {record.rule_name}: {record.output[0]}", file=sys.stderr)
