"""A fork server: one process imports the libraries once, and runs each job of a run in a fork of itself.

The import of numpy, torch and Numba takes two seconds, as long as a small job. A fork starts with all modules that
earlier jobs have imported. It is still a process of its own: its memory, its threads and its random numbers are not
those of other jobs, and a job that is killed harms no other.

The server is an optimisation. Without one (another host, another operating system than Linux, a job started by hand)
`run_in_fork` runs the job in its own process.
"""

from __future__ import annotations

import atexit
import gc
import json
import mmap
import os
import selectors
import signal
import socket
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from carigs.errors import print_line
from carigs.system.run_process import end_with_run_process, name_run_process, run_process_is_alive

FORK_SERVER = "CARIGS_FORK_SERVER"
"""Environment variable with the name of the server's socket."""
CORES = "CARIGS_CORES"
"""Environment variable with the number of cores that the jobs of a run share."""
SECONDS_BETWEEN_CHECKS = 0.5
STARTING_THREADS = ("ai_edge_litert",)
"""Packages that start threads when they are imported: the server leaves that to the jobs. Numba ends a fork that begins
a parallel loop, if OpenMP had threads before the fork."""
NUM_STREAMS = 3
"""Standard input, output and error of a job are those of the process that asks for it."""


_running = mmap.mmap(-1, 4)
"""Number of jobs that run now, in the server; its forks share this page."""
_serving = False
"""Whether this process is a server, and not yet the job that a fork of it becomes."""


def start_fork_server(cores: int) -> None:
    """Start a server for the jobs of this process; it ends soon after this process. Only Linux has one.

    Args:
        cores: Number of cores that the jobs share.
    """
    if not hasattr(os, "pidfd_open"):
        return
    name_run_process()
    # A name that begins with a zero byte is not a file: nothing stays behind, however the processes end.
    address = f"carigs-{os.getpid()}-{os.urandom(8).hex()}"
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(f"\0{address}")
        listener.listen(64)
        command = [sys.executable, "-c", f"from carigs.system.fork_server import _serve; _serve({listener.fileno()})"]
        server = subprocess.Popen(command, pass_fds=[listener.fileno()], stdin=subprocess.DEVNULL)
    atexit.register(_end, server)
    os.environ[FORK_SERVER], os.environ[CORES] = address, str(cores)


def _end(server: subprocess.Popen) -> None:
    server.terminate()
    server.wait()


def share_of_cores() -> int:
    """Cores of the run for each of the jobs that run now.

    Returns:
        Number of cores; 1 in a process that is not a fork of a server.
    """
    jobs = int.from_bytes(_running[:], sys.byteorder)
    return max(int(os.environ.get(CORES, 1)) // jobs, 1) if jobs else 1


def is_fork_server() -> bool:
    """Whether this process is a server, or a fork of one that has just begun.

    Returns:
        False in a job.
    """
    return _serving


def _count_jobs(change: int) -> None:
    _running[:] = (int.from_bytes(_running[:], sys.byteorder) + change).to_bytes(4, sys.byteorder)


def run_in_fork(function: str, arguments: dict[str, Any]) -> int:
    """Run a job in a fork of the server, or in this process if there is no server.

    Args:
        function: `module:name` of a function that returns an exit code.
        arguments: Its keywords; JSON can hold them. `log` is the file of its messages: if a signal ends the job, a line
            is written there.

    Returns:
        The exit code; that of a process that a signal has ended is negative.
    """
    with socket.socket(socket.AF_UNIX) as server:
        try:
            server.connect(f"\0{os.environ[FORK_SERVER]}")
        except (KeyError, OSError):
            end_with_run_process()
            return _call(function, arguments)
        job = {"function": function, "arguments": arguments, "folder": os.getcwd(), "environment": dict(os.environ)}
        message = json.dumps(job).encode()
        socket.send_fds(server, [len(message).to_bytes(8, "little")], range(NUM_STREAMS))
        server.sendall(message)
        code = server.makefile("rb").read()
    if not code or int(code) < 0:
        _report_end("the fork server was killed" if not code else _end_by_signal(-int(code)), arguments.get("log"))
    return int(code or 1)


def _end_by_signal(number: int) -> str:
    if number == signal.SIGKILL:
        return "the job was killed, as Linux does when memory runs out"
    return f"the job was ended by {signal.Signals(number).name}"


def _report_end(line: str, log: str | None) -> None:
    """Say how a job has ended that cannot say it itself, at the end of its log, too."""
    print_line(line)
    if log is not None:
        with suppress(OSError), open(log, "a", encoding="utf-8") as file:
            print(f"\ncarigs: {line}", file=file)


def _call(function: str, arguments: dict[str, Any]) -> int:
    module, _, name = function.partition(":")
    return getattr(import_module(module), name)(**arguments)


@dataclass(frozen=True)
class _Job:
    """A fork that runs a job."""

    pid: int
    pidfd: int
    client: socket.socket
    modules: int
    """File in memory, in which the fork lists its modules when it ends."""


def _serve(listener: int) -> None:
    """Accept jobs until the process of the run has ended.

    This process must not have threads: a lock that another thread holds at a fork is never released in the fork.
    """
    global _serving
    _serving = True
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the jobs and the process of the run
    with socket.socket(fileno=listener) as accepting, selectors.DefaultSelector() as selector:
        selector.register(accepting, selectors.EVENT_READ, None)
        while run_process_is_alive():
            for key, _ in selector.select(SECONDS_BETWEEN_CHECKS):
                if key.data is None:
                    _start(accepting, selector)
                elif key.fileobj == key.data.pidfd:
                    _finish(key.data, selector)
                else:  # the client has ended before its job
                    selector.unregister(key.fileobj)
                    signal.pidfd_send_signal(key.data.pidfd, signal.SIGKILL)


def _start(accepting: socket.socket, selector: selectors.BaseSelector) -> None:
    """Accept a client and fork."""
    client, _ = accepting.accept()
    try:
        user = int.from_bytes(client.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, 12)[4:8], sys.byteorder)
        if user != os.getuid():
            raise PermissionError("a client of another user")
        client.settimeout(10)
        size, streams, _, _ = socket.recv_fds(client, 8, NUM_STREAMS)
        message = _receive(client, int.from_bytes(size + _receive(client, 8 - len(size)), "little"))
        client.settimeout(None)
    except OSError:
        client.close()
        return
    modules = os.memfd_create("modules")
    gc.freeze()  # a collection in the fork then writes to none of the pages that both share
    _count_jobs(+1)
    pid = os.fork()
    if pid == 0:
        for key in list(selector.get_map().values()):
            os.close(key.fd)
        selector.close()
        client.detach()
        _run_forked(json.loads(message), streams, modules)
    for stream in streams:
        os.close(stream)
    job = _Job(pid, os.pidfd_open(pid), client, modules)
    selector.register(job.pidfd, selectors.EVENT_READ, job)
    selector.register(client, selectors.EVENT_READ, job)


def _receive(client: socket.socket, size: int) -> bytes:
    received = bytearray()
    while len(received) < size:
        part = client.recv(size - len(received))
        if not part:
            raise ConnectionError("the client has ended")
        received += part
    return bytes(received)


def _run_forked(job: dict[str, Any], streams: list[int], modules: int) -> None:
    """Be the job: its folder, environment and streams; never returns."""
    global _serving
    _serving, code = False, 1
    try:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        for number, stream in enumerate(streams):
            os.dup2(stream, number)
            os.close(stream)
        os.chdir(job["folder"])
        os.environ.clear()
        os.environ.update(job["environment"])
        name_run_process(os.getppid())
        end_with_run_process()
        known = set(sys.modules)
        _limit_threads(os.environ.get("OMP_NUM_THREADS", ""))
        code = _call(job["function"], job["arguments"])
        new = [name for name, module in sys.modules.items() if name not in known and getattr(module, "__spec__", None)]
        os.write(modules, json.dumps(new).encode())
    except KeyboardInterrupt:
        code = 130
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        with suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _limit_threads(count: str) -> None:
    """Set the number of threads of BLAS and OpenMP libraries that are loaded already; others read the environment."""
    if count.isdigit() and "numpy" in sys.modules:
        from threadpoolctl import threadpool_limits

        threadpool_limits(int(count))


def _finish(job: _Job, selector: selectors.BaseSelector) -> None:
    """Tell the client the exit code, and import what the job has imported, for the jobs to come."""
    _, status = os.waitpid(job.pid, 0)
    _count_jobs(-1)
    selector.unregister(job.pidfd)
    os.close(job.pidfd)
    with suppress(KeyError):
        selector.unregister(job.client)
    with job.client, suppress(OSError):
        job.client.sendall(str(os.waitstatus_to_exitcode(status)).encode())
    with os.fdopen(job.modules, "rb") as file:
        file.seek(0)
        for name in json.loads(file.read() or b"[]"):
            if name not in sys.modules and name.partition(".")[0] not in STARTING_THREADS:
                with suppress(Exception):  # some modules are made by others, and have no file of their own
                    import_module(name)
    if "numba" in sys.modules:  # what the first kernel of every fork would do
        from numba.core.registry import cpu_target

        cpu_target.typing_context.refresh()
        cpu_target.target_context.refresh()
