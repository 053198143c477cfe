"""What made the outputs of a job: settings, code and inputs, in a small JSON file beside its log.

Snakemake decides by modification times, and by notes in `.snakemake/`, which do not come along when results are copied.
At its start a run therefore sets the modification times of outputs from these records: outputs of the present settings,
code and inputs get the time when they were made, if a copy has lost it; others get the year 1970, and Snakemake makes
them again. Contents are not changed, so that this is right for a dry run, too.
"""

from __future__ import annotations

import os
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from hashlib import file_digest, sha256
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

from carigs.errors import InputError
from carigs.files import write_json
from carigs.job_lock import job_lock
from carigs.lap_times import forget_times, mean_times
from carigs.readers.json_files import json_field, read_json

STALE = 1_000_000_000
"""Modification time of outputs that are to be made again, in nanoseconds since 1970. (Snakemake ignores 0.)"""
_MADE_FROM = ("settings", "code", "inputs")


class JobCosts(NamedTuple):
    """What a job has cost."""

    seconds: float
    """Wall time."""
    cpu_seconds: float
    """Processor time of all threads."""
    peak_memory_mb: float | None
    """Largest resident size of the process; None where the operating system does not count it."""
    steps: Mapping[str, float] = MappingProxyType({})
    """Mean wall time of the steps that the stage measures (`carigs.lap_times`)."""


Costs = Mapping[tuple[str, str], JobCosts]
"""Costs of jobs by stage and name of the log without suffix."""


@contextmanager
def recorded_job(
    log: Path,
    settings: Path,
    code: str,
    inputs: Iterable[Path],
    outputs: Iterable[Path],
    outside: Mapping[str, str],
) -> Iterator[None]:
    """Hold the lock of a job while it runs, and record at its end what made its outputs.

    The record has the name of the log and the suffix `.json`. It lists the outputs alone until the job is complete.
    Then it also says what the job has cost: wall time, CPU time, the largest resident size of its process, and the mean
    time of the steps that the stage measures.

    Args:
        log: Log file of the job, `results/{study}/log/{stage}/{point}.log`.
        settings: File with the settings.
        code: Fingerprint of the code.
        inputs: Input files and folders. Those that jobs of the study have made are recorded.
        outputs: Output files and folders.
        outside: Digest of each file or folder outside of the study that the job reads (`carigs.outside_files`).

    Yields:
        Nothing.

    Raises:
        CarigsError: Another process runs the same job.
    """
    file, outputs = log.with_suffix(".json"), list(outputs)
    with job_lock(log.with_suffix(".lock")):
        write_json(file, {"finished": None, "outputs": {str(output): "" for output in outputs}})
        made = _digests(_read_records(log.parents[1]).values())
        record = {
            "settings": {str(settings): content_digest(settings)},
            "code": code,
            "inputs": {str(path): made[str(path)] for path in inputs if str(path) in made},
            "outside": dict(outside),
        }
        forget_times()
        started = _costs()
        yield
        seconds, cpu_seconds = (after - before for after, before in zip(_costs(), started, strict=True))
        digests = {str(output): content_digest(output) for output in outputs}
        finished = time.time_ns()
        costs = {"seconds": seconds, "cpu_seconds": cpu_seconds, "peak_memory_mb": _peak_memory_mb()}
        costs["steps"] = mean_times()
        write_json(file, {"finished": finished, **record, "outputs": digests, "costs": costs})
        _set_time(file, finished)


def set_modification_times(
    folder: Path,
    settings_text: Callable[[str, str], str | None],
    code: Callable[[str], str],
    outside: Callable[[str], str],
) -> dict[tuple[str, str], int]:
    """Set the modification times of the outputs of a study from its records.

    Args:
        folder: The study's folder of logs and records, `results/{study}/log`.
        settings_text: The present settings for a stage and the name of a settings file without suffix; None if the
            study cannot have them any more.
        code: The present fingerprint of a stage.
        outside: The present digest of a file or folder outside of the study; empty if it is not there. Results can be
            used where their dataset is not.

    Returns:
        Number of jobs by stage and reason, of those whose outputs are to be made again.

    Raises:
        InputError: A record is malformed.
    """
    records = _read_records(folder)
    made, stale = _digests(records.values()), Counter()
    for file, record in records.items():
        stage = file.parent.name
        if reason := _difference(record, stage, settings_text, code, made, outside):
            stale[stage, reason] += any(Path(output).exists() for output in record["outputs"])
            for output in record["outputs"]:
                mark_stale(Path(output))
        else:
            _restore_times(file, record)
    return {key: count for key, count in stale.items() if count}


def unfinished_jobs(folder: Path, since: float) -> list[Path]:
    """List the jobs that began and did not end.

    Args:
        folder: The study's folder of logs and records, `results/{study}/log`.
        since: Time in seconds since 1970; jobs that began before are left out.

    Returns:
        The log file of each, in the order in which they began.

    Raises:
        InputError: A record is malformed.
    """
    began = {file: file.stat().st_mtime for file, record in _read_records(folder).items() if not record["finished"]}
    return [file.with_suffix(".log") for file in sorted(began, key=began.get) if began[file] >= since]


def job_costs(folder: Path) -> dict[tuple[str, str], JobCosts]:
    """Read what the jobs of a study have cost.

    Args:
        folder: The study's folder of logs and records, `results/{study}/log`.

    Returns:
        The costs of each finished job whose record has them, by stage and name of the log without suffix.

    Raises:
        InputError: A record is malformed.
    """
    found = {}
    for file, record in _read_records(folder).items():
        if record["finished"] and "costs" in record:
            costs = json_field(record, "costs", dict, file=file)
            kinds = {"seconds": float, "cpu_seconds": float, "peak_memory_mb": float}
            if costs.get("peak_memory_mb") is None:
                del kinds["peak_memory_mb"]
            values = {key: json_field(costs, key, kind, file=file, where="costs") for key, kind in kinds.items()}
            steps = json_field(costs, "steps", dict, file=file, where="costs") if "steps" in costs else {}
            steps = {step: json_field(steps, step, float, file=file, where="costs.steps") for step in steps}
            found[file.parent.name, file.stem] = JobCosts(**{"peak_memory_mb": None, **values}, steps=steps)
    return found


def mark_stale(path: Path) -> None:
    """Let Snakemake make a file or folder again.

    Args:
        path: The file or folder; nothing happens if it is not there.
    """
    _set_time(path, STALE)


def mark_current(path: Path) -> None:
    """Give a settings file a time before all outputs but those that are to be made again.

    Args:
        path: The file.
    """
    _set_time(path, STALE + 10**9)


def is_stale(path: Path) -> bool:
    """Whether a file or folder is marked to be made again.

    Args:
        path: The file or folder.

    Returns:
        False also if it is not there.
    """
    return path.exists() and _stamp(path).stat().st_mtime_ns == STALE


def is_from_future(path: Path) -> bool:
    """Whether a file or folder is newer than the present: the clock of this or of another host was wrong.

    Args:
        path: The file or folder.

    Returns:
        False also if it is not there.
    """
    return path.exists() and _stamp(path).stat().st_mtime_ns > time.time_ns()


def content_digest(path: Path) -> str:
    """Digest of a file, or of the names and contents of all files below a folder, without hidden ones.

    Args:
        path: The file or folder.

    Returns:
        Hexadecimal digits; empty if there is nothing of this name.
    """
    if not path.is_dir():
        if not path.is_file():
            return ""
        with path.open("rb") as stream:
            return file_digest(stream, "sha256").hexdigest()[:32]
    files = sorted(file for file in path.rglob("*") if file.is_file() and not file.name.startswith("."))
    lines = (f"{file.relative_to(path).as_posix()} {content_digest(file)}" for file in files)
    return sha256("\n".join(lines).encode()).hexdigest()[:32]


def _costs() -> tuple[float, float]:
    """Wall and CPU time, of all threads and finished child processes."""
    times = os.times()
    return times.elapsed, times.user + times.system + times.children_user + times.children_system


def _peak_memory_mb() -> float | None:
    """Largest resident size of this process so far; None where the operating system does not count it."""
    try:
        import resource
    except ImportError:
        return None
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak / (2**20 if sys.platform == "darwin" else 2**10)


def _read_records(folder: Path) -> dict[Path, dict[str, Any]]:
    files = (file for file in sorted(folder.glob("*/*.json")) if not file.name.startswith("."))
    records = {file: read_json(file, dict) for file in files}
    for file, record in records.items():
        if not {"finished", "outputs", *(_MADE_FROM if record.get("finished") else ())} <= record.keys():
            raise InputError("not the record of a job; delete it, and its outputs", file=file)
    return records


def _digests(records: Iterable[dict[str, Any]]) -> dict[str, str]:
    """The digests of all outputs; empty for those of jobs that were not finished.

    What was made from an earlier state of such outputs is to be made again: Snakemake would leave them missing.
    """
    return {path: digest for record in records for path, digest in record["outputs"].items()}


def _difference(
    record: dict[str, Any],
    stage: str,
    settings_text: Callable[[str, str], str | None],
    code: Callable[[str], str],
    made: dict[str, str],
    outside: Callable[[str], str],
) -> str | None:
    """Why the outputs of a job are to be made again, or None."""
    if not record["finished"]:
        return "not finished"
    for file, digest in record["settings"].items():
        text = settings_text(stage, Path(file).stem)
        if text is not None and sha256(text.encode()).hexdigest()[:32] != digest:
            return "made with other settings"
    if record["code"] != code(stage):
        return "made with other code"
    if any(made.get(path, digest) != digest for path, digest in record["inputs"].items()):
        return "made from other inputs"
    for path, digest in record.get("outside", {}).items():
        if outside(path) not in (digest, ""):
            return f"made from another state of {path}"
    return None


def _restore_times(file: Path, record: dict[str, Any]) -> None:
    """Give outputs the time when they were made, if a copy, an earlier run or a wrong clock has given them another one.

    Snakemake ends a run in which an input is newer than the present.
    """
    copied = not _is_time(file.stat().st_mtime_ns, record["finished"])
    finished = min(record["finished"], time.time_ns())
    for output, digest in record["outputs"].items():
        path = Path(output)
        if path.exists() and (copied or is_stale(path) or is_from_future(path)):
            if content_digest(path) == digest:
                _set_time(path, finished)
            elif is_from_future(path):
                _set_time(path, time.time_ns())
    if copied:
        for settings, digest in record["settings"].items():
            if content_digest(Path(settings)) == digest:
                mark_current(Path(settings))
        _set_time(file, record["finished"])


def _is_time(stored: int, time: int) -> bool:
    """Whether a modification time is what a file system stores for a time, both in nanoseconds.

    Some file systems store microseconds, others whole or even seconds.
    """
    return abs(stored - time) < 1_000_000 or (stored % 1_000_000_000 == 0 and abs(stored - time) < 2_000_000_000)


def _stamp(path: Path) -> Path:
    """What has the modification time of an output: of a folder, a file that Snakemake writes into it."""
    stamp = path / ".snakemake_timestamp"
    return stamp if stamp.is_file() else path


def _set_time(path: Path, nanoseconds: int) -> None:
    for part in {path, _stamp(path)}:
        try:
            os.utime(part, ns=(nanoseconds, nanoseconds))
        except OSError:  # not there, or not ours: results that cannot be written are not made again either
            pass
