"""Snakemake's graph of jobs, in which records decide which results are current.

Snakemake compares modification times, and its notes in the working folder. Both are lost when results are copied, and
neither tells whether a file is damaged. No interface of Snakemake takes such a decision from outside, so the graph is a
subclass. Nothing is written in a dry run. Every other run first locks its studies, removes what processes that were
killed have left, and writes the settings files.
"""

from __future__ import annotations

import os
import shutil
import time
from collections import Counter
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path

import snakemake.workflow
from snakemake.dag import DAG
from snakemake.jobs import Job
from snakemake_interface_storage_plugins.io import Mtime

from carigs.errors import CarigsError, one_line, print_line
from carigs.runs.contents import content_digest, text_digest
from carigs.runs.current_results import outdated_jobs
from carigs.runs.locks import lock_study, remove_free_locks
from carigs.runs.plan import name_time_of_planning
from carigs.runs.planned_job import PlannedJob, planned_job
from carigs.system.files import clean_results, writing


def use_study_graph() -> None:
    """Let Snakemake plan this run with `StudyGraph`."""
    name_time_of_planning()
    snakemake.workflow.DAG = StudyGraph


class StudyGraph(DAG):
    """The jobs of a run. Those whose results are not current are to be run, and modification times do not count."""

    _recorded: Collection[Job] = ()

    async def check_incomplete(self) -> None:
        """Mark results that are not current like those that a killed job has left incomplete.

        Snakemake calls this when it knows all jobs, before it decides which of them to run.

        Raises:
            SystemExit: Another run makes the same study, or its results cannot be written.
        """
        await super().check_incomplete()
        jobs = [job for level in self.toposorted() for job in level if not any(f.is_storage for f in job.output)]
        stages = {job: planned_job(job) for job in jobs if "plan" in job.params.keys()}
        settings = [job for job in jobs if job.rule.name == "settings"]
        runs = self.workflow.executor_plugin is not None and not self.workflow.dryrun
        if runs:
            with _ends_in_a_line():
                _take_over({stage.study for stage in stages.values()})
                self._write_settings(settings)
        written = {str(job.output[0]): text_digest(job.params.text) for job in settings}
        triggers = {trigger.name.lower().replace("_", "-") for trigger in self.workflow.rerun_triggers}
        outdated = outdated_jobs(stages.values(), written, triggers)
        for job, stage in stages.items():
            if stage in outdated:
                self.forcefiles.update(job.output)
                if runs:
                    _remove_other_kinds(job)
        current = [job for job, stage in stages.items() if stage not in outdated]
        self._ignore_modification_times([*settings, *current], runs)
        self._ignore_notes_of_snakemake({*settings, *stages})
        for line in _lines(outdated):
            print_line(line)

    async def update_needrun(self, create_inventory: bool = False) -> None:
        """Find the jobs to run. Where there are records, nobody is told that notes of Snakemake are missing.

        Args:
            create_inventory: As in the class that this one extends.
        """
        await super().update_needrun(create_inventory)
        for job in self._recorded:
            self.reason(job).no_metadata = False

    async def clean(self, only_temp: bool = False, dryrun: bool = False) -> None:
        """Delete the outputs of all jobs.

        Args:
            only_temp: As in the class that this one extends.
            dryrun: As in the class that this one extends.

        Raises:
            SystemExit: Another run makes the same study.
        """
        if not dryrun:
            with _ends_in_a_line():
                _take_over({planned_job(job).study for job in self.jobs if "plan" in job.params.keys()})
        await super().clean(only_temp, dryrun)

    def _ignore_notes_of_snakemake(self, jobs: Collection[Job]) -> None:
        """Let Snakemake find no notes of jobs that have records.

        The notes are of the last run in this working folder. Results may be of another one: copied, restored, or made
        in a folder that shares them.
        """
        self._recorded, notes = jobs, self.workflow.persistence
        has_metadata = notes.has_metadata
        notes.has_metadata = lambda job: job not in jobs and has_metadata(job)

    def _write_settings(self, jobs: list[Job]) -> None:
        """Write the settings files that are missing, damaged, or of an earlier run.

        A file that a rule makes again has all that was made from it made again, also where no result depends on the
        change, such as that of a number of threads.
        """
        for job in jobs:
            file, text = job.output[0], job.params.text
            if content_digest(Path(file)) != text_digest(text):
                with writing(file) as part:
                    part.write_text(text, "utf-8", newline="\n")
                self.workflow.iocache.exists_local[file] = True

    def _ignore_modification_times(self, jobs: list[Job], runs: bool) -> None:
        """Let outputs have one modification time while Snakemake plans: their contents are compared instead.

        Snakemake ends a run in which an input is newer than an output that has just been made: what comes from the
        future, because some clock was wrong, gets the present time.
        """
        now = time.time()
        for job in jobs:
            for output in filter(os.path.exists, job.output):
                self.workflow.iocache.mtime[output] = Mtime(local=now)
                if runs:
                    _leave_the_future(Path(output), now)


@contextmanager
def _ends_in_a_line() -> Iterator[None]:
    """End the process with one line on an error, to which Snakemake would add the place in the code."""
    try:
        yield
    except (CarigsError, OSError) as error:
        print_line(str(one_line(error)))
        raise SystemExit(1) from None


def _take_over(studies: set[Path]) -> None:
    """Lock studies, and remove what killed processes have left in their results."""
    for folder in sorted(studies):
        lock_study(folder / "log")
        clean_results(folder, no_job_runs=remove_free_locks(folder / "log"))


def _remove_other_kinds(job: Job) -> None:
    """Remove a folder in the place of a file, and the other way around, which Snakemake leaves there."""
    for output in job.output:
        path = Path(output)
        if path.is_dir() and not output.is_directory:
            shutil.rmtree(path)
        elif path.is_file() and output.is_directory:
            path.unlink()


def _leave_the_future(path: Path, now: float) -> None:
    for file in (path, path / ".snakemake_timestamp"):  # which stands for the folder
        try:
            if file.stat().st_mtime > now:
                os.utime(file, (now, now))
        except OSError:  # not there, or not ours
            pass


def _lines(outdated: dict[PlannedJob, str]) -> list[str]:
    counts = Counter((stage.study, stage.stage, reason) for stage, reason in outdated.items())
    lines = []
    for (study, stage, reason), count in counts.items():
        results = "1 result was" if count == 1 else f"{count} results were"
        lines.append(f"{study}: {stage}: {results} {reason}; what this run needs of it is made again")
    return lines
