"""Run the stage named like the rule: its files and parameters are the keywords, what it says goes to the log."""

import re
import sys
import traceback
from contextlib import redirect_stderr, redirect_stdout
from importlib import import_module
from pathlib import Path
from typing import TextIO

from carigs.config import load_settings
from carigs.errors import CarigsError

FOR_THE_WORKFLOW = ("settings", "watch", "watch_targets", "code")
"""Inputs and parameters that decide when a stage runs and are none of its keywords."""


class Log:
    """Text for the log file and, if somebody is watching, the terminal; progress bars leave only their last state."""

    def __init__(self, file: TextIO, terminal: TextIO | None):
        self.file, self.terminal, self.line = file, terminal, ""
        self.encoding = "utf-8"

    def write(self, text: str) -> int:
        """Show all of it, log each line as it looks when it is complete."""
        if self.terminal:
            self.terminal.write(text)
        *lines, self.line = (self.line + text).split("\n")
        for line in lines:
            plain = re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", line).rstrip("\r")
            self.file.write(plain.rpartition("\r")[2] + "\n")
        return len(text)

    def flush(self) -> None:
        """Flush both."""
        self.file.flush()
        if self.terminal:
            self.terminal.flush()

    def isatty(self) -> bool:
        """Whether progress bars make sense."""
        return self.terminal is not None


def paths(files: object) -> Path | list[Path]:
    """Snakemake's file names as paths: one, or a list; an input that a job has no use for is an empty list."""
    return Path(files) if isinstance(files, str) else [Path(file) for file in files]


def run(job) -> None:
    """Call the stage of a Snakemake job; what is the user's fault ends in one line, on the terminal and in the log."""
    rule, terminal = job.rule, sys.stderr
    files = {name: paths(files) or None for name, files in {**job.input, **job.output}.items()}
    keywords = {**files, **job.params}
    with open(job.log[0], "w", buffering=1, encoding="utf-8") as file:
        log = Log(file, terminal if terminal.isatty() else None)
        try:
            with redirect_stdout(log), redirect_stderr(log):
                stage = getattr(import_module(f"carigs.stages.{rule}"), rule)
                settings = load_settings(rule, keywords["settings"])
                stage(settings, **{name: value for name, value in keywords.items() if name not in FOR_THE_WORKFLOW})
        except CarigsError as error:
            for place in (file, terminal):
                print(f"carigs: {job.output[0]}: {error}", file=place)
            sys.exit(1)
        except Exception:
            for place in (file, terminal):
                traceback.print_exc(file=place)
            sys.exit(1)


run(snakemake)
