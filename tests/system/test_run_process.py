"""Jobs end with the process that started the run."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import psutil
import pytest
from processes import ends, has_ended

from carigs.system.run_process import RUN_PROCESS

JOB = """
import time
from carigs.system.run_process import end_with_run_process
end_with_run_process()
print('job\\n', end='', flush=True)
time.sleep(60)
"""
RUN = """
import subprocess, sys, time
from carigs.system.run_process import name_run_process
name_run_process()
job = subprocess.Popen(["sh", "-c", f'"{sys.executable}" -c "$JOB"; true'])  # as Snakemake starts jobs: in a shell
print("run\\n", end="", flush=True)  # in one write: the job writes to the same pipe
time.sleep(60)
"""


@pytest.fixture
def run():
    environment = {name: value for name, value in os.environ.items() if name != RUN_PROCESS}
    process = subprocess.Popen(
        [sys.executable, "-c", RUN], env={**environment, "JOB": JOB}, stdout=subprocess.PIPE, text=True,
        start_new_session=True,
    )  # fmt: skip
    assert {process.stdout.readline().strip() for _ in range(2)} == {"run", "job"}
    yield process
    try:
        os.killpg(process.pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    process.wait()
    process.stdout.close()


def _jobs(process: subprocess.Popen) -> list[int]:
    return [child.pid for child in psutil.Process(process.pid).children(recursive=True) if "python" in child.name()]


def test_a_job_ends_when_the_run_is_killed(run):
    (job,) = _jobs(run)
    time.sleep(1.5)
    assert not has_ended(job)
    run.kill()  # the run alone: the job becomes an orphan
    run.wait()
    assert ends(job)


@pytest.mark.parametrize("named", ["", "elsewhere 1 0", "nonsense", "{host} {pid} 0", "{host} 99999999 0"])
def test_a_job_of_no_run_goes_on(named):
    import socket

    named = named.format(host=socket.gethostname(), pid=os.getpid())
    code = JOB.replace("time.sleep(60)", "time.sleep(1.5); print('done')")
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, RUN_PROCESS: named}, capture_output=True, text=True
    )
    assert done.stdout.split() == ["job", "done"]
