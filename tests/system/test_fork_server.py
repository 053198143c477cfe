"""Jobs in forks of one server: their streams, folder, environment and exit code, and who ends with whom."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from contextlib import contextmanager

import psutil
import pytest
from processes import ends, started, until

from carigs.runs.summary import error_lines
from carigs.system.fork_server import CORES, FORK_SERVER, share_of_cores
from carigs.system.run_process import RUN_PROCESS

pytestmark = pytest.mark.skipif(not hasattr(os, "pidfd_open"), reason="only Linux has a fork server")

RUN = """
import subprocess, sys
from carigs.system.fork_server import FORK_SERVER, start_fork_server
start_fork_server(6)  # cores
import os
print(os.environ[FORK_SERVER], flush=True)
sys.stdin.read()
"""
JOBS = """
import json, os, signal, sys, time

def describe(**arguments):
    modules = [name for name in ("numpy", "decimal") if name in sys.modules]
    about = dict(arguments=arguments, folder=os.getcwd(), home=os.environ.get("HOME"), pid=os.getpid(), modules=modules)
    print(json.dumps(about), flush=True)
    print("to stderr", file=sys.stderr)
    return 0

def learn():
    import decimal
    return 0

def start_threads():
    import ai_edge_litert
    return 0

def parallel_loop():
    from loop_of_test import total
    return int(total(1000) != 1000)

def end(code):
    return code

def folder_of_kernels():
    from carigs.simd.kernel_cache import kernel_folder
    print(kernel_folder(), flush=True)
    return 0

def cores():
    from carigs.system.fork_server import share_of_cores
    print(share_of_cores(), flush=True)
    return 0

def fail():
    raise RuntimeError("a mistake")

def killed(number=9, log=None):
    os.kill(os.getpid(), number)

def wait():
    print(os.getpid(), flush=True)
    time.sleep(60)
    return 0
"""
LOOP = """
import numba

@numba.njit(parallel=True)
def total(count):
    result = 0
    for i in numba.prange(count):
        result += 1
    return result
"""
CLIENT = """
import json, sys
from carigs.system.fork_server import run_in_fork
sys.exit(run_in_fork(f"jobs_of_test:{sys.argv[1]}", json.loads(sys.argv[2])) & 255)
"""


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """Environment of clients of a server, which ends with the module's tests."""
    folder = tmp_path_factory.mktemp("jobs")
    (folder / "jobs_of_test.py").write_text(JOBS)
    (folder / "loop_of_test.py").write_text(LOOP)
    (folder / "ai_edge_litert.py").write_text(
        "from loop_of_test import total\ntotal(10)\n"
    )  # as if it were the package
    clean = {name: value for name, value in os.environ.items() if name not in (RUN_PROCESS, FORK_SERVER)}
    clean["PYTHONPATH"] = os.pathsep.join([str(folder), os.environ.get("PYTHONPATH", "")])
    with server_of_a_run(clean) as (_, its_environment):
        yield its_environment


@contextmanager
def server_of_a_run(clean):
    """A run with its server, and the environment of the server's clients."""
    with started([sys.executable, "-c", RUN], env=clean, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as run:
        yield run, {**clean, FORK_SERVER: run.stdout.readline().strip(), CORES: "6"}
        run.communicate()  # closes its input, at which it ends


def client(environment, function, arguments=None, **options):
    command = [sys.executable, "-c", CLIENT, function, json.dumps(arguments or {})]
    return started(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, **options)


def done(environment, function, arguments=None, **options):
    with client(environment, function, arguments, **options) as process:
        output, errors = process.communicate(timeout=60)
        return process.returncode, output, errors, process.pid


def test_a_job_has_the_arguments_streams_folder_and_environment_of_its_client(environment, tmp_path):
    arguments = {"text": "ä\n", "many": ["x" * 50] * 2000, "number": 0.25}
    code, output, errors, pid = done({**environment, "HOME": "/elsewhere"}, "describe", arguments, cwd=tmp_path)
    about = json.loads(output)
    assert code == 0 and errors == "to stderr\n"
    assert about["arguments"] == arguments and about["folder"] == str(tmp_path) and about["home"] == "/elsewhere"
    assert about["pid"] != pid


def test_later_jobs_start_with_the_modules_that_earlier_ones_imported(environment):
    assert done(environment, "learn")[0] == 0
    assert "decimal" in json.loads(done(environment, "describe")[1])["modules"]


def test_threads_that_a_package_starts_do_not_reach_the_server(environment):
    assert done(environment, "start_threads")[0] == 0
    assert done(environment, "parallel_loop")[0] == 0


def test_every_job_loads_the_kernels_of_the_present_sources(environment):
    folders = [done(environment, "folder_of_kernels")[1] for _ in range(2)]
    assert "kernels-" in folders[0]
    assert folders[0] == folders[1]


@pytest.mark.parametrize(
    ("number", "named"), [(signal.SIGKILL, "memory"), (signal.SIGSEGV, "SIGSEGV"), (signal.SIGTERM, "SIGTERM")]
)
def test_the_signal_that_ends_a_job_is_the_last_line_of_its_log(environment, tmp_path, number, named):
    log = tmp_path / "a.log"
    log.write_text("step 7")
    code, _, errors, _ = done(environment, "killed", {"number": int(number), "log": str(log)})
    assert code == 256 - number and named in errors
    (line,) = error_lines([log])
    assert line == f"{errors.strip().removeprefix('carigs: ')} ({log})"


def test_exit_codes(environment):
    assert done(environment, "end", {"code": 7})[0] == 7
    code, _, errors, _ = done(environment, "killed")
    assert code == 256 - signal.SIGKILL and "memory" in errors
    code, _, errors, _ = done(environment, "fail")
    assert code == 1 and errors.endswith("RuntimeError: a mistake\n")


def test_the_jobs_that_run_share_the_cores(environment):
    assert share_of_cores() == 1  # this process is not a job
    assert done(environment, "cores")[1] == "6\n"
    with client(environment, "wait") as first:
        first.stdout.readline()
        assert done(environment, "cores")[1] == "3\n"
        with client(environment, "wait") as second:
            second.stdout.readline()
            assert done(environment, "cores")[1] == "2\n"
    assert until(lambda: done(environment, "cores")[1] == "6\n")


def test_a_job_ends_with_its_client(environment):
    with client(environment, "wait") as process:
        job = int(process.stdout.readline())
        process.kill()
        assert ends(job)
    assert done(environment, "end", {"code": 0})[0] == 0  # the server goes on


def test_server_and_jobs_end_with_the_run(environment):
    clean = {name: value for name, value in environment.items() if name != FORK_SERVER}
    with server_of_a_run(clean) as (run, own), client(own, "wait") as waiting:
        (server,) = psutil.Process(run.pid).children()
        job = int(waiting.stdout.readline())
        run.kill()
        assert ends(server.pid) and ends(job)
        _, errors = waiting.communicate(timeout=60)
        assert waiting.returncode == 1 and "fork server was killed" in errors
        assert done(own, "end", {"code": 3})[0] == 3  # without a server, the client runs the job itself


def test_jobs_end_with_a_killed_server(environment):
    clean = {name: value for name, value in environment.items() if name != FORK_SERVER}
    with server_of_a_run(clean) as (run, own), client(own, "wait") as waiting:
        (server,) = psutil.Process(run.pid).children()
        job = int(waiting.stdout.readline())
        server.kill()
        assert waiting.wait(timeout=60) == 1
        assert ends(job)


def test_without_a_server_a_job_runs_in_its_own_process(environment):
    clean = {name: value for name, value in environment.items() if name != FORK_SERVER}
    code, output, _, pid = done(clean, "describe")
    assert code == 0 and json.loads(output)["pid"] == pid
