"""Run the stage named like the rule: inputs, outputs and parameters are its keywords, its messages go to the log."""

import re
import sys
import traceback
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import TextIO

from carigs.config import load_settings
from carigs.errors import CarigsError
from carigs.run_process import end_with_run_process

WORKFLOW_ONLY = ("settings", "watch", "watch_targets", "code")
"""Inputs and parameters of the rule that are not keywords of the stage."""


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


def _paths(files: object) -> Path | list[Path]:
    """Snakemake's file names as paths: one, or a list, which is empty for an unused input."""
    return Path(files) if isinstance(files, str) else [Path(file) for file in files]


def _run(job) -> None:
    """Call the stage of a Snakemake job; errors of the input are one line, on the terminal and in the log."""
    end_with_run_process()
    rule, terminal = job.rule, sys.stderr
    files = {name: _paths(files) or None for name, files in {**job.input, **job.output}.items()}
    keywords = {**files, **job.params}
    with open(job.log[0], "w", buffering=1, encoding="utf-8") as file:
        log = _Log(file, terminal if terminal.isatty() else None)
        try:
            with redirect_stdout(log), redirect_stderr(log):
                stage = getattr(import_module(f"carigs.stages.{rule}"), rule)
                settings = load_settings(rule, keywords["settings"])
                stage(settings, **{name: value for name, value in keywords.items() if name not in WORKFLOW_ONLY})
        except CarigsError as error:
            for place in (file, terminal):
                print(f"carigs: {job.output[0]}: {error}", file=place)
            sys.exit(1)
        except Exception:
            for place in (file, terminal):
                traceback.print_exc(file=place)
            sys.exit(1)


_run(snakemake)
