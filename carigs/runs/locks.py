"""Locks inside the results: one run of a study, and one process for each job, at a time, whichever host they are on.

Snakemake's own lock is in the working folder. Two runs in different folders whose `results` lead to the same place do
not see it.
"""

from __future__ import annotations

import atexit
import errno
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from pathlib import Path

from carigs.errors import CarigsError
from carigs.system.processes import this_process

try:
    import fcntl
except ImportError:  # Windows, which also removes no file that is open
    fcntl = None

SECONDS_TO_WAIT = 10.0
"""The jobs of a run that was killed end a moment after it."""


@contextmanager
def job_lock(file: Path, seconds: float = SECONDS_TO_WAIT) -> Iterator[None]:
    """Hold the lock of a job. The system releases it when the process ends, however it ends.

    Args:
        file: Lock file; it names the holder, and is removed at the end.
        seconds: How long to wait for another holder.

    Yields:
        Nothing. On Windows and on a file system without locks, nothing is locked.

    Raises:
        CarigsError: Another process holds the lock; the message names its host and process id.
    """
    if fcntl is None:
        yield
        return
    with _hold(file, "another process writes the outputs of this job", seconds):
        try:
            yield
        finally:
            file.unlink(missing_ok=True)


def lock_study(folder: Path) -> None:
    """Hold the lock of a study until this process ends, so that no other run plans or makes it meanwhile.

    Args:
        folder: The study's folder of logs, `results/{study}/log`.

    Raises:
        CarigsError: Another run holds the lock, or the folder cannot be written.
    """
    if fcntl is None:
        return
    file = folder / "run.lock"
    try:
        stream = _hold(file, "another run makes this study", seconds=1)
    except OSError as error:
        raise CarigsError(f"{file}: {error.strerror}; results are written here") from error
    atexit.register(_release, file, stream, os.getpid())


def remove_free_locks(folder: Path) -> bool:
    """Remove the lock files that processes have left that were killed.

    Args:
        folder: Folder of the lock files, and of folders with more of them.

    Returns:
        Whether all locks of jobs were free: then no job of the study runs, on any host. False where there are no locks.
    """
    if not fcntl:
        return False
    free = True
    for file in folder.glob("*/*.lock"):
        with suppress(OSError):  # results that cannot be written can still be planned and reported
            if stream := _locked(file, without_locks=False):
                with stream:
                    file.unlink(missing_ok=True)
            else:
                free = False
    return free


def _hold(file: Path, problem: str, seconds: float) -> TextIOWrapper:
    """Lock a file and write the name of this process into it."""
    file.parent.mkdir(parents=True, exist_ok=True)
    deadline = time.monotonic() + seconds
    while (stream := _locked(file)) is None:
        if time.monotonic() > deadline:
            raise CarigsError(f"{file}: {problem}: {_holder(file)}")
        time.sleep(0.2)
    stream.truncate(0)
    stream.write("process {0.pid} on host {0.host}".format(this_process()))
    stream.flush()
    return stream


def _release(file: Path, stream: TextIOWrapper, holder: int) -> None:
    if os.getpid() == holder:  # not in a fork, which runs the functions of `atexit`, too
        with stream:
            file.unlink(missing_ok=True)


def _locked(file: Path, without_locks: bool = True) -> TextIOWrapper | None:
    """The lock file, open and locked; None if another process has locked it.

    On a file system without locks `without_locks` says whether the file counts as locked by this process.
    """
    stream = file.open("a", encoding="utf-8")
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if file.stat().st_ino == os.fstat(stream.fileno()).st_ino:
            return stream
    except FileNotFoundError:  # the last holder has removed it in the meantime
        pass
    except OSError as error:
        if error.errno not in (errno.EAGAIN, errno.EACCES) and without_locks:
            return stream
    stream.close()
    return None


def _holder(file: Path) -> str:
    try:
        return file.read_text("utf-8") or "its name is not known"
    except OSError:
        return "it has just ended"
