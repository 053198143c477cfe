"""Run a stage as a job of the workflow: its messages go to a log, errors that a user can cause are one line."""

from __future__ import annotations

import re
import sys
import traceback
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from inspect import signature
from pathlib import Path
from typing import Any, TextIO

from carigs.config import load_settings
from carigs.errors import CarigsError, InputError, exit_code, one_line
from carigs.runs.job_record import recorded_job
from carigs.runs.plan import code_is_planned, settings_digest
from carigs.runs.planned_job import PlannedJob
from carigs.runs.summary import warnings_as_lines


class _Log:
    """Stream to the log file and, if there is one, to the terminal; the log keeps the last state of a progress bar."""

    def __init__(self, file: TextIO, terminal: TextIO | None):
        self.file, self.terminal, self.line = file, terminal, ""
        self.encoding = "utf-8"

    def write(self, text: str) -> int:
        """Write text to the terminal at once, and complete lines to the log, without escape sequences.

        Args:
            text: What a stage prints.

        Returns:
            Number of characters, as for every text stream.
        """
        if self.terminal:
            self.terminal.write(text)
        *lines, self.line = (self.line + text).split("\n")
        for line in lines:
            plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", line).rstrip("\r")
            self.file.write(plain.rpartition("\r")[2] + "\n")
        return len(text)

    def flush(self) -> None:
        """Flush the file and the terminal."""
        self.file.flush()
        if self.terminal:
            self.terminal.flush()

    def isatty(self) -> bool:
        """Whether there is a terminal, for progress bars.

        Returns:
            True if the terminal shows what is written.
        """
        return self.terminal is not None


def run_job(settings: str, files: dict[str, str | list[str]], job: dict[str, Any], threads: int = 1) -> int:
    """Call a stage; an error is one line, on the terminal and at the end of the log.

    A mistake of the program is printed with its traceback before that line.

    Args:
        settings: File with the settings of the stage.
        files: Inputs and outputs by the stage's keywords: a file, or a list of files, which is empty for an unused
            input.
        job: Fields of the `PlannedJob`. Its stage is the name of the module in `carigs.stages`, of its function, and of
            its section in the settings; messages name its first output.
        threads: Cores that Snakemake reserves for the job; no result depends on it.

    Returns:
        Exit code.
    """
    planned = PlannedJob(**{**job, "inputs": tuple(job["inputs"]), "outputs": tuple(job["outputs"])})
    paths = {name: Path(file) if isinstance(file, str) else [*map(Path, file)] or None for name, file in files.items()}
    terminal = sys.stderr
    try:
        with open(planned.log, "w", buffering=1, encoding="utf-8") as file:
            stream = _Log(file, terminal if terminal.isatty() else None)
            try:
                with (
                    recorded_job(planned) as key,
                    redirect_stdout(stream),
                    redirect_stderr(stream),
                    warnings_as_lines(),
                ):
                    _call(planned, Path(settings), paths, {"resume_key": key, "threads": threads})
            except (Exception, KeyboardInterrupt) as error:
                print(_message(planned.outputs[0], error), file=file)
                raise
    except (Exception, KeyboardInterrupt) as error:  # also of the log: its disk may be full, its folder read-only
        print(_message(planned.outputs[0], error), file=terminal)
        return exit_code(error)
    return 0


def _call(
    job: PlannedJob, settings: Path, paths: dict[str, Path | list[Path] | None], offered: dict[str, str | int]
) -> None:
    """Call the function of the stage. It gets what it takes of the key of an unfinished job, and of the threads."""
    section = load_settings(job.stage, settings)
    if settings_digest(job.stage, section) != job.plan["settings"]:
        raise InputError("another run has replaced the settings that this job was planned with", file=settings)
    if not code_is_planned(job.stage, job.plan["code"]):
        raise CarigsError("the code of this stage was edited after the run had planned this job; start the run again")
    function = getattr(import_module(f"carigs.stages.{job.stage}"), job.stage)
    taken = {name: value for name, value in offered.items() if name in signature(function).parameters}
    function(section, **paths, **job.params, **taken)


def _message(output: str, error: BaseException) -> str:
    line, traced = one_line(error), ""
    if line is None:
        line = str(CarigsError(f"{type(error).__name__}: {error}; this is an error of carigs, traced in its log"))
        traced = "".join(traceback.format_exception(error))
    return f"{traced}carigs: {output}: {line}"
