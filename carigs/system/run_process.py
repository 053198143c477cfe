"""The process that a run belongs to: jobs end when it has ended, however it ended.

A Snakemake process that is killed cannot stop its jobs. Without a guard, a training of it would go on, and would
replace the results of a later run when it ends.
"""

from __future__ import annotations

import os
import sys
import threading
import time

from carigs.system.processes import ProcessName, is_alive, process_name

RUN_PROCESS = "CARIGS_RUN_PROCESS"
"""Environment variable that names the process: the fields of its `ProcessName`, divided by blanks."""
SECONDS_BETWEEN_CHECKS = 0.5


def name_run_process(pid: int | None = None) -> None:
    """Let jobs belong to a process.

    Args:
        pid: The process. If None, this process, or the one that it belongs to itself.
    """
    if pid is not None or not run_process_is_alive():
        os.environ[RUN_PROCESS] = " ".join(map(str, process_name(pid or os.getpid())))


def run_process_is_alive() -> bool:
    """Whether the process that this one belongs to is on this host and has not ended.

    Returns:
        False also if no process is named.
    """
    return _named_process() is not None


def end_with_run_process() -> None:
    """End this process soon after the one that it belongs to has ended.

    Nothing happens if no process is named, or if the named process is on another host or has ended already: the job is
    then started by hand, or by a scheduler that watches it.
    """
    if process := _named_process():
        threading.Thread(target=_watch, args=(process,), daemon=True, name="run process").start()


def _named_process() -> ProcessName | None:
    """The process that the environment names, if it is on this host and has not ended."""
    *names, pid, start = ["", "", "", *os.environ.get(RUN_PROCESS, "").split(" ")][-4:]
    if not (pid.isdecimal() and start.isdecimal()):
        return None
    process = ProcessName(*names, int(pid), int(start))
    return process if is_alive(process) else None


def _watch(process: ProcessName) -> None:
    while is_alive(process):
        time.sleep(SECONDS_BETWEEN_CHECKS)
    print("carigs: the run that this job belongs to has ended; the job ends, too", file=sys.__stderr__, flush=True)
    os._exit(1)  # at once, whatever the other threads do: outputs have their names only when they are complete
