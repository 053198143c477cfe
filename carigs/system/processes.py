"""Names of processes: system, process id and start. A later process with the same id has another start."""

from __future__ import annotations

import os
import socket
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import NamedTuple

import psutil


class ProcessName(NamedTuple):
    """What tells a process from all others, those of other hosts, of other containers and of other times."""

    host: str
    """Name of the host. Containers and hosts may share one."""
    system: str
    """Digest of the boot and of the name space of process ids: `pid` means something only within it."""
    pid: int
    start: int
    """Clock ticks from the start of the system to that of the process: steps of the clock do not change it."""


def this_process() -> ProcessName:
    """The name of the calling process.

    Returns:
        Its name.
    """
    return process_name(os.getpid())


def process_name(pid: int) -> ProcessName:
    """The name of a process of this host.

    Args:
        pid: Its id.

    Returns:
        Its name.
    """
    return ProcessName(socket.gethostname(), _system(), pid, _start(pid) or 0)


def is_known(process: ProcessName) -> bool:
    """Whether this process can see whether another one is alive.

    Args:
        process: Its name.

    Returns:
        False for processes of other hosts, of other containers, and of the time before this system was started.
    """
    return process.host == socket.gethostname() and process.system == _system()


def is_alive(process: ProcessName) -> bool:
    """Whether a process is known to be alive.

    Args:
        process: Its name.

    Returns:
        False also for processes that are not known (`is_known`).
    """
    return is_known(process) and _start(process.pid) == process.start


@cache
def _system() -> str:
    """Digest of the boot and of the PID name space; of nothing where the operating system does not tell."""
    known = []
    for read in (
        lambda: Path("/proc/sys/kernel/random/boot_id").read_text(),
        lambda: os.readlink("/proc/self/ns/pid"),
    ):
        try:
            known.append(read())
        except OSError:
            known.append("")
    return sha256("".join(known).encode()).hexdigest()[:8]


def _start(pid: int) -> int | None:
    """Start of a process of this host; None if it has ended."""
    if Path("/proc/self/stat").exists():
        try:
            state, *fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
        except OSError:
            return None
        return None if state in "ZX" else int(fields[18])
    try:
        process = psutil.Process(pid)
        return None if process.status() == psutil.STATUS_ZOMBIE else int(process.create_time())
    except psutil.Error:
        return None
