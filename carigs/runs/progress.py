"""One line for each job that a run starts. Snakemake prints about ten, which the file that it keeps has in any case."""

from __future__ import annotations

import logging
import sys
from collections.abc import Collection


def show_job_lines(logger: logging.Logger, jobs: int, small_rules: Collection[str]) -> None:
    """Let a logger show a line per job, and of its other messages warnings and errors only.

    Args:
        logger: Snakemake's. What it writes to files stays as it is.
        jobs: Number of jobs of the run.
        small_rules: Rules whose jobs have no line: they only write settings, or collect files.
    """
    for handler in logger.handlers:
        if isinstance(handler, logging.StreamHandler) and not isinstance(handler, logging.FileHandler):
            handler.setLevel(logging.WARNING)
    logger.addHandler(_JobLines(jobs, small_rules))


class _JobLines(logging.Handler):
    """Prints rule and first output of a job when it starts, and how many jobs are done."""

    def __init__(self, jobs: int, small_rules: Collection[str]):
        super().__init__(logging.INFO)
        self.done, self.jobs, self.small_rules = 0, jobs, small_rules

    def emit(self, record: logging.LogRecord) -> None:
        """Print the line of a record that tells of a job's start.

        Args:
            record: A record of Snakemake's; its attribute `event` says what happened.
        """
        event = getattr(record, "event", None)
        if event == "progress":
            self.done, self.jobs = record.done, record.total
        elif event == "job_info" and record.rule_name not in self.small_rules:
            print(f"[{self.done} of {self.jobs} done] starting {record.rule_name}: {record.output[0]}", file=sys.stderr)
