"""Run a stage as a job of the workflow: its messages go to a log, errors that a user can cause are one line."""

from __future__ import annotations

import re
import sys
import traceback
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import Any, TextIO

from carigs.config import load_settings
from carigs.errors import CarigsError, exit_code, one_line
from carigs.job_record import recorded_job
from carigs.run_summary import warnings_as_lines


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


def run_job(
    stage: str,
    settings: str,
    files: dict[str, str | list[str]],
    params: dict[str, Any],
    code: str,
    inputs: list[str],
    outputs: list[str],
    outside: dict[str, str],
    log: str,
) -> int:
    """Call a stage; an error is one line, on the terminal and at the end of the log.

    A mistake of the program is printed with its traceback before that line.

    Args:
        stage: Name of the module in `carigs.stages`, of its function and of its section in the settings.
        settings: File with the section.
        files: Inputs and outputs by the stage's keywords: a file, or a list of files, which is empty for an unused
            input.
        params: Further keywords.
        code: Fingerprint of the stage's code.
        inputs: All inputs of the job, for its record.
        outputs: All outputs of the job. Messages name the first.
        outside: Digests of the files and folders outside of the study that the settings name, for the record.
        log: File to write.

    Returns:
        Exit code.
    """
    paths = {name: Path(file) if isinstance(file, str) else [*map(Path, file)] or None for name, file in files.items()}
    terminal = sys.stderr
    try:
        with open(log, "w", buffering=1, encoding="utf-8") as file:
            stream = _Log(file, terminal if terminal.isatty() else None)
            try:
                record = recorded_job(Path(log), Path(settings), code, map(Path, inputs), map(Path, outputs), outside)
                with record, redirect_stdout(stream), redirect_stderr(stream), warnings_as_lines():
                    function = getattr(import_module(f"carigs.stages.{stage}"), stage)
                    function(load_settings(stage, settings), **paths, **params)
            except (Exception, KeyboardInterrupt) as error:
                print(_message(outputs[0], error), file=file)
                raise
    except (Exception, KeyboardInterrupt) as error:  # also of the log: its disk may be full, its folder read-only
        print(_message(outputs[0], error), file=terminal)
        return exit_code(error)
    return 0


def _message(output: str, error: BaseException) -> str:
    line, traced = one_line(error), ""
    if line is None:
        line = str(CarigsError(f"{type(error).__name__}: {error}; this is an error of carigs, traced in its log"))
        traced = "".join(traceback.format_exception(error))
    return f"{traced}carigs: {output}: {line}"
