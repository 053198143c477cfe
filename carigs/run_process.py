"""The process that a run belongs to: jobs end when it has ended, however it ended.

A Snakemake process that is killed cannot stop its jobs. Without a guard, a training of it would go on, and would
replace the results of a later run when it ends.
"""

from __future__ import annotations

import os
import socket
import sys
import threading
import time

import psutil

RUN_PROCESS = "CARIGS_RUN_PROCESS"
"""Environment variable that names the process: host, process id and time of its start."""
SECONDS_BETWEEN_CHECKS = 0.5


def name_run_process(pid: int | None = None) -> None:
    """Let jobs belong to a process.

    Args:
        pid: The process. If None, this process, or the one that it belongs to itself.
    """
    if pid is not None or not run_process_is_alive():
        process = psutil.Process(pid)
        os.environ[RUN_PROCESS] = f"{socket.gethostname()} {process.pid} {process.create_time()}"


def run_process_is_alive() -> bool:
    """Whether the process that this one belongs to is on this host and has not ended.

    Returns:
        False also if no process is named.
    """
    return _is_alive(os.environ.get(RUN_PROCESS, ""))


def end_with_run_process() -> None:
    """End this process soon after the one that it belongs to has ended.

    Nothing happens if no process is named, or if the named process is on another host or has ended already: the job is
    then started by hand, or by a scheduler that watches it.
    """
    named = os.environ.get(RUN_PROCESS, "")
    if _is_alive(named):
        threading.Thread(target=_watch, args=(named,), daemon=True, name="run process").start()


def _is_alive(named: str) -> bool:
    """Whether a named process is on this host and has not ended. Its time of start tells it from later ones."""
    host, _, rest = named.partition(" ")
    pid, _, start = rest.partition(" ")
    if host != socket.gethostname() or not pid.isdigit():
        return False
    try:
        process = psutil.Process(int(pid))
        return process.create_time() == float(start) and process.status() != psutil.STATUS_ZOMBIE
    except (psutil.Error, ValueError):
        return False


def _watch(named: str) -> None:
    while _is_alive(named):
        time.sleep(SECONDS_BETWEEN_CHECKS)
    print("carigs: the run that this job belongs to has ended; the job ends, too", file=sys.__stderr__, flush=True)
    os._exit(1)  # at once, whatever the other threads do: outputs have their names only when they are complete
