"""Names of processes: host, process id and start. A later process with the same id has another start."""

from __future__ import annotations

import os
import socket
from pathlib import Path
from typing import NamedTuple

import psutil


class ProcessName(NamedTuple):
    """What tells a process from all others, those of other hosts and of other times."""

    host: str
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
    return ProcessName(socket.gethostname(), pid, _start(pid) or 0)


def is_alive(process: ProcessName) -> bool:
    """Whether a process is on this host and has not ended.

    Args:
        process: Its name.

    Returns:
        False also for processes of other hosts, about which nothing is known.
    """
    return process.host == socket.gethostname() and _start(process.pid) == process.start


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
