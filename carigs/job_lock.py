"""A lock per job: one process writes its outputs at a time, whichever host it is on."""

from __future__ import annotations

import errno
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from io import TextIOWrapper
from pathlib import Path

from carigs.errors import CarigsError
from carigs.processes import this_process

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
    file.parent.mkdir(parents=True, exist_ok=True)
    deadline = time.monotonic() + seconds
    while (stream := _locked(file)) is None:
        if time.monotonic() > deadline:
            raise CarigsError(f"{file}: another process writes the outputs of this job: {_holder(file)}")
        time.sleep(0.2)
    with stream:
        try:
            stream.truncate(0)
            stream.write("process {0.pid} on host {0.host}".format(this_process()))
            stream.flush()
            yield
        finally:
            file.unlink(missing_ok=True)


def remove_free_locks(folder: Path) -> None:
    """Remove the lock files that processes have left that were killed.

    Args:
        folder: Folder of the lock files, and of folders with more of them.
    """
    for file in folder.rglob("*.lock") if fcntl else ():
        with suppress(OSError):  # results that cannot be written can still be planned and reported
            if stream := _locked(file):
                with stream:
                    file.unlink(missing_ok=True)


def _locked(file: Path) -> TextIOWrapper | None:
    """The lock file, open and locked; None if another process has locked it."""
    stream = file.open("a", encoding="utf-8")
    try:
        fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if file.stat().st_ino == os.fstat(stream.fileno()).st_ino:
            return stream
    except FileNotFoundError:  # the last holder has removed it in the meantime
        pass
    except OSError as error:
        if error.errno not in (errno.EAGAIN, errno.EACCES):
            return stream
    stream.close()
    return None


def _holder(file: Path) -> str:
    try:
        return file.read_text("utf-8") or "its name is not known"
    except OSError:
        return "it has just ended"
