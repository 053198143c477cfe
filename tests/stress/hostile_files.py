"""Hostile and damaged files at every reader: each is read right or refused in one line that names it.

Every case runs in another process, whose time, memory and calls of the system are watched.

Example:
    PYTHONPATH=tests python -m stress.hostile_files results/stress/hostile_files.csv
"""

from __future__ import annotations

import json
import os
import resource
import select
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from carigs.errors import CarigsError, InputError
from carigs.simd.kernel_cache import kernel_folder
from evaluation.command_line import csv_parser, run
from evaluation.tables.csv_files import write_csv
from stress.hostile_cases.case import Case
from stress.hostile_cases.cases import cases
from stress.hostile_readers import READERS, sound_files, summary

SECONDS = 10.0
"""Longest time of a case."""
MEGABYTES = 400
"""Largest growth of the memory in one case."""
CANARY = "ran"
"""File in the working directory that payloads write."""
CALLS = ("os.system", "os.exec", "os.posix_spawn", "os.fork", "subprocess.Popen", "socket.connect")
"""Audit events of Python that no reader causes."""


class Outcome(NamedTuple):
    """Result of a case."""

    case: str
    reader: str
    outcome: str
    """`right`, `typed error`, or in capitals what is wrong."""
    seconds: float
    megabytes: float
    message: str

    @property
    def holds(self) -> bool:
        """Whether the file was read right or refused as it should be."""
        return self.outcome in ("right", "typed error")


def read_case(case: Case, folder: Path, expected: dict[str, Any]) -> tuple[str, str]:
    """Read the file of a case.

    Args:
        case: The case.
        folder: Where the file is written.
        expected: What each reader returns for its sound file.

    Returns:
        Outcome and message.
    """
    read, name = READERS[case.reader]
    file = folder / name
    if callable(case.content):
        file.unlink()
        case.content(file)
    elif case.reader != "override":
        file.write_bytes(case.content)
    try:
        found = read(case.content.decode() if case.reader == "override" else file)
    except CarigsError as error:
        text = str(error)
        is_named = not isinstance(error, InputError) or str(folder) in text or "https://" in text
        is_line = text.isprintable() and len(text) < 3000
        return ("typed error" if is_named and is_line else "NOT NAMED OR NOT ONE LINE"), text
    except BaseException as error:
        return "TRACEBACK", f"{type(error).__name__}: {' '.join(str(error).split())[:200]}"
    if case.must_fail:
        return "ACCEPTED", ""
    if case.protected and summary(found) != expected[case.reader]:
        return "SILENTLY WRONG", ""
    return "right", ""


def work() -> None:
    """Serve cases: indices come on stdin, results go to stdout as JSON."""
    called: list[str] = []
    with tempfile.TemporaryDirectory() as name, tempfile.TemporaryDirectory() as cache:
        folder = Path(name)
        os.chdir(folder)
        os.environ["XDG_CACHE_HOME"] = cache  # empty: a first reading may write to it
        kernel_folder()  # found now, and not during an audit
        contents = sound_files(folder)
        expected = {
            reader: summary(read(folder / file)) for reader, (read, file) in READERS.items() if reader != "override"
        }
        everything = list(cases(contents))
        virtual = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (virtual + (8 << 30), resource.RLIM_INFINITY))

        def note(event: str, arguments: tuple[Any, ...]) -> None:
            if _is_hostile(event, arguments):
                called.append(f"{event} {arguments[0]!r}" if arguments else event)

        sys.addaudithook(note)
        results = os.fdopen(os.dup(1), "w", buffering=1)
        os.dup2(2, 1)
        print(json.dumps({"cases": len(everything)}), file=results)
        for line in sys.stdin:
            case = everything[int(line)]
            before, start = _peak_megabytes(), time.monotonic()
            called.clear()
            outcome, message = read_case(case, folder, expected)
            if case.reader != "override":
                _restore(folder / READERS[case.reader][1], contents[case.reader])
            seconds, megabytes = time.monotonic() - start, _peak_megabytes() - before
            if (folder / CANARY).exists() or called:
                outcome, message = "RAN CODE", ", ".join(called)
                (folder / CANARY).unlink(missing_ok=True)
            elif seconds > SECONDS or megabytes > MEGABYTES + (
                0 if callable(case.content) else 40e-6 * len(case.content)
            ):
                outcome = "TOO MUCH TIME OR MEMORY"
            record = Outcome(case.name, case.reader, outcome, seconds, megabytes, message)
            print(json.dumps(record), file=results)


def _restore(file: Path, content: bytes) -> None:
    """Put the sound file back in place of whatever is there."""
    if file.is_dir() and not file.is_symlink():
        file.rmdir()
    elif file.is_symlink() or not file.is_file():
        file.unlink(missing_ok=True)
    file.write_bytes(content)


def _is_hostile(event: str, arguments: tuple[Any, ...]) -> bool:
    """Whether an audit event is none of a reader: a call, or a change of files outside the working directory."""
    if event in CALLS:
        return True
    written = (
        event == "open" and isinstance(arguments[2], int) and arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT)
    )
    if not (written or event == "os.remove") or not isinstance(arguments[0], (str, bytes, os.PathLike)):
        return False
    path = Path(os.path.abspath(os.fsdecode(arguments[0])))
    allowed = (Path.cwd(), kernel_folder() or Path.cwd(), Path(os.environ["XDG_CACHE_HOME"]), Path(os.devnull))
    return not any(path.is_relative_to(place) for place in allowed)


def _peak_megabytes() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


class _Worker:
    """A process that serves cases."""

    def __init__(self) -> None:
        command = [sys.executable, "-X", "faulthandler", "-m", "stress.hostile_files", "--worker"]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.cases = self._answer(600)["cases"]

    def _answer(self, seconds: float) -> Any:
        ready, _, _ = select.select([self.process.stdout], [], [], seconds)
        line = self.process.stdout.readline() if ready else ""
        return json.loads(line) if line else None

    def run(self, index: int) -> list | None:
        """The result of a case; None if it crashed or took too long."""
        self.process.stdin.write(f"{index}\n")
        self.process.stdin.flush()
        return self._answer(3 * SECONDS)

    def stop(self) -> str:
        """End the process; how it ended before."""
        status = self.process.poll()
        self.process.kill()
        self.process.wait()
        return "TIMEOUT" if status is None else f"CRASH ({status})"


def outcomes() -> Iterator[Outcome]:
    """Run every case.

    Yields:
        Results.
    """
    with tempfile.TemporaryDirectory() as folder:
        names = [(case.name, case.reader) for case in cases(sound_files(Path(folder)))]
    worker = _Worker()
    for index, (name, reader) in enumerate(names):
        record = worker.run(index)
        if record is None:
            yield Outcome(name, reader, worker.stop(), np.nan, np.nan, "")
            worker = _Worker()
        else:
            yield Outcome(*record)
    worker.stop()


def main() -> bool:
    """Run all cases from the command line, and write the results.

    Returns:
        Whether one fails.
    """
    if sys.argv[1:] == ["--worker"]:
        work()
        return False
    arguments = csv_parser(__doc__).parse_args()
    results = list(outcomes())
    write_csv(arguments.rows, results, Outcome, digits=2)
    failed = [result for result in results if not result.holds]
    for outcome in sorted({result.outcome for result in results}):
        print(f"{sum(result.outcome == outcome for result in results):5} {outcome}")
    print(f"{len(results)} cases, {len(failed)} do not hold")
    for result in failed:
        print(f"  {result.reader}: {result.case}: {result.outcome} {result.message}")
    return bool(failed)


if __name__ == "__main__":
    run(main)
