"""Commands `python -m MODULE` as forks of one process that has imported Snakemake, its plugins, and Hydra.

To import these takes a second, as long as the rest of most commands of the workflow's tests. Nothing of carigs is
imported before the fork: every command imports the packages that its own `PYTHONPATH` names.
"""

from __future__ import annotations

import atexit
import gc
import json
import os
import runpy
import subprocess
import sys
from functools import cache
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

IMPORTED = ("hydra", "snakemake.cli", "snakemake.report.html_reporter", "yte")


def run_command(command: tuple[str, ...], folder: Path, environment: dict[str, str]) -> subprocess.CompletedProcess:
    """What `python -m COMMAND` in a folder prints and returns, as of a session of its own."""
    if not hasattr(os, "fork"):
        line = [sys.executable, "-m", *command]
        return subprocess.run(line, cwd=folder, env=environment, capture_output=True, text=True)
    with TemporaryDirectory() as results:
        files = [Path(results, name) for name in ("output", "errors")]
        request = {"command": command, "folder": str(folder), "environment": environment, "files": [*map(str, files)]}
        server = _server()
        print(json.dumps(request), file=server.stdin, flush=True)
        code = int(server.stdout.readline())
        return subprocess.CompletedProcess(command, code, *(file.read_text() for file in files))


@cache
def _server() -> subprocess.Popen:
    """One for each process of pytest; it ends with its standard input."""
    clean = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    command = [sys.executable, "-P", __file__]  # -P: without the folder of this file in sys.path
    server = subprocess.Popen(command, env=clean, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    atexit.register(server.communicate)  # closes its input, and waits for its end
    return server


def _serve() -> None:
    for name in IMPORTED:
        import_module(name)
    import_module("snakemake.cli").get_argument_parser()  # imports the plugins
    gc.freeze()
    gc.set_threshold(100_000, 50, 1000)  # as in conftest.py
    for line in sys.stdin:
        if (child := os.fork()) == 0:
            _become(**json.loads(line))
        print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]), flush=True)


def _become(command: list[str], folder: str, environment: dict[str, str], files: list[str]) -> None:
    os.setsid()
    os.chdir(folder)
    for stream, file in enumerate([os.devnull, *files]):
        os.dup2(os.open(file, os.O_RDWR | os.O_CREAT), stream)
    os.environ.clear()
    os.environ.update(environment)
    sys.path[:0] = [folder, *environment.get("PYTHONPATH", "").split(os.pathsep)]
    sys.argv[:] = command
    runpy.run_module(command[0], run_name="__main__", alter_sys=True)
    sys.exit()


if __name__ == "__main__":
    _serve()
