"""Warnings as lines: of a command on stderr, of a job in its log; a run repeats those of its jobs at its end."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from carigs.errors import CarigsError, CarigsWarning, print_line
from carigs.runs.locks import job_lock

ERROR_PREFIX = "carigs: "
PREFIX = "carigs: warning: "


@contextmanager
def warnings_as_lines() -> Iterator[None]:
    """Print warnings of the class `CarigsWarning` as lines; others are shown as always.

    Yields:
        Nothing.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("always", CarigsWarning)
        show = warnings.showwarning

        def show_message(message: Warning | str, category: type[Warning], *place: object, **more: object) -> None:
            if issubclass(category, CarigsWarning):
                print_line(f"warning: {CarigsError(str(message))}")
            else:
                show(message, category, *place, **more)

        warnings.showwarning = show_message
        yield


def logged_warnings(folder: Path) -> dict[str, list[Path]]:
    """The warnings in the logs of a study.

    Args:
        folder: The study's folder of logs, `results/{study}/log`.

    Returns:
        The log files of each different warning.
    """
    found: dict[str, list[Path]] = {}
    for file in sorted(folder.glob("*/*.log")):
        for line in file.read_text("utf-8", "replace").splitlines():
            if line.startswith(PREFIX) and file not in found.setdefault(line.removeprefix(PREFIX), []):
                found[line.removeprefix(PREFIX)].append(file)
    return found


def warning_lines(folders: Iterable[Path]) -> list[str]:
    """The warnings of studies for their user, one line each.

    Args:
        folders: As for `logged_warnings`.

    Returns:
        Each different warning with the first log file that has it.
    """
    lines, found = [], {}
    for folder in folders:
        for warning, files in logged_warnings(folder).items():
            found.setdefault(warning, []).extend(files)
    for warning, (first, *others) in found.items():
        also = f" and {len(others)} more" if others else ""
        lines.append(f"{warning} ({first}{also})")
    return lines


def error_lines(logs: Iterable[Path]) -> list[str]:
    """The errors of jobs that have begun and not ended, one line each.

    Args:
        logs: Their log files.

    Returns:
        Of each log its last line if that is an error, else what is known of the end of the job, with the log file.
    """
    lines = []
    for log in logs:
        text = log.read_text("utf-8", "replace").rstrip() if log.is_file() else ""
        last = text.rpartition("\n")[2]
        is_error = last.startswith(ERROR_PREFIX) and not last.startswith(PREFIX)
        lines.append(f"{last.removeprefix(ERROR_PREFIX) if is_error else _silent_end(log, last)} ({log})")
    return lines


def _silent_end(log: Path, last: str) -> str:
    """What is known of a job that has not ended, and whose log has no error."""
    try:
        with suppress(OSError), job_lock(log.with_suffix(".lock"), 0):  # OSError: results that cannot be written
            pass
    except CarigsError as error:
        return f"this run did not start the job: {error}"
    done = f"after it wrote: {last}" if last else "before it wrote anything"
    return f"the job ended without an error {done}; its process was killed, by the system, a scheduler or a user"
