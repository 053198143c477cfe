"""A Slurm cluster on this machine: munge, one controller and several nodes, in a folder, for one user."""

from __future__ import annotations

import getpass
import os
import shutil
import socket
import subprocess
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import psutil

DAEMONS = ("munged", "slurmctld", "slurmd")
COMMANDS = ("sbatch", "scancel", "scontrol", "sinfo", "squeue", "srun")
# No cgroups and no accounting database, which need more rights. Jobs of a lost node restart after cred_expire seconds.
CONFIGURATION = """
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={folder}/munge/socket,cred_expire=5
CredType=cred/munge
SlurmctldPort={port}
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmctldLogFile={folder}/slurmctld.log
SlurmdPidFile={folder}/%n.pid
SlurmdLogFile={folder}/%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SlurmdParameters=config_overrides
SchedulerParameters=sched_interval=1,bf_interval=1
EnforcePartLimits=ALL
ReturnToService=2
SlurmdTimeout=5
KillWait=5
MinJobAge=7200
GresTypes=gpu
PartitionName=main Nodes=ALL Default=YES State=UP
"""


class SlurmCluster:
    """Controller and nodes; every node has two cores, 64 GB of memory and a GPU, which are not checked."""

    def __init__(self, folder: Path, nodes: tuple[str, ...]):
        self.folder, self.nodes = folder, nodes
        self.daemons: dict[str, subprocess.Popen] = {}
        host, ports = socket.gethostname().partition(".")[0], _free_ports(1 + len(nodes))
        text = CONFIGURATION.format(host=host, user=getpass.getuser(), folder=folder, port=ports[0])
        for node, port in zip(nodes, ports[1:], strict=True):
            resources = "CPUs=2 RealMemory=64000 Gres=gpu:1"
            text += f"NodeName={node} NodeHostname={host} NodeAddr=127.0.0.1 Port={port} {resources}\n"
            (folder / node).mkdir()
        (folder / "slurm.conf").write_text(text)
        (folder / "gres.conf").write_text(f"NodeName={','.join(nodes)} Name=gpu File=/dev/null\n")
        for name in ("munge", "state", "bin"):
            (folder / name).mkdir()
        (folder / "munge").chmod(0o711)
        (folder / "munge/key").write_bytes(os.urandom(1024))
        (folder / "munge/key").chmod(0o600)
        # Snakemake removes SLURM_CONF from the environment of what it starts in a job.
        for program in COMMANDS:
            wrapper = folder / "bin" / program
            wrapper.write_text(f'#!/bin/sh\nSLURM_CONF={folder}/slurm.conf exec {which(program)} "$@"\n')
            wrapper.chmod(0o755)

    def environment(self) -> dict[str, str]:
        """Environment variables of the commands that use the cluster."""
        path = os.pathsep.join([str(self.folder / "bin"), os.environ["PATH"], "/usr/sbin"])
        return {"SLURM_CONF": str(self.folder / "slurm.conf"), "PATH": path}

    def start(self) -> None:
        """Start the daemons, and wait until the nodes take jobs."""
        munge = [f"--{name}-file={self.folder}/munge/{name}" for name in ("key", "pid", "log", "seed")]
        self._start("munged", "--foreground", "--force", f"--socket={self.folder}/munge/socket", *munge)
        wait_until((self.folder / "munge/socket").exists, 10)
        self._start("slurmctld", "-D", "-c")
        for node in self.nodes:
            self.start_node(node)

    def start_node(self, node: str) -> None:
        """Start the daemon of a node, and wait until the node takes jobs."""
        self._start("slurmd", "-D", "-N", node, name=node)
        wait_until(lambda: self.state(node) in ("idle", "mixed", "allocated"), 30)

    def lose_node(self, node: str) -> None:
        """Kill all processes of a node: its daemon, and all of each job."""
        log = str(self.folder / f"{node}.log")
        processes = [process for process in psutil.process_iter() if log in _open_files(process)]
        assert processes, f"nothing runs on {node}"
        for process in [child for p in processes for child in p.children(recursive=True)] + processes:
            try:
                process.kill()
            except psutil.NoSuchProcess:
                pass
        self.daemons.pop(node).wait()

    def state(self, node: str) -> str:
        """State of a node as `sinfo` shows it."""
        return self.run("sinfo", "--noheader", "--nodes", node, "--format", "%T").rstrip("*\n")

    def jobs(self) -> list[dict[str, str]]:
        """What `scontrol show job` says of each job, running or finished."""
        return [
            dict(word.split("=", 1) for word in line.split() if "=" in word)
            for line in self.run("scontrol", "--oneliner", "show", "job").splitlines()
            if line.startswith("JobId=")
        ]

    def run(self, *command: str) -> str:
        """Output of a command, which may fail."""
        environment = {**os.environ, **self.environment()}
        return subprocess.run(command, env=environment, capture_output=True, text=True).stdout

    def stop(self) -> None:
        """Cancel the jobs and end the daemons."""
        if "slurmctld" in self.daemons:
            self.run("scancel", "--user", getpass.getuser(), "--signal", "KILL", "--full")
        for node in [node for node in self.nodes if node in self.daemons]:
            self.lose_node(node)
        for daemon in self.daemons.values():
            daemon.terminate()
            daemon.wait(timeout=20)

    def _start(self, program: str, *arguments: str, name: str | None = None) -> None:
        self.daemons[name or program] = subprocess.Popen(
            [which(program), *arguments],
            env={**os.environ, **self.environment()},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )


@contextmanager
def slurm_cluster(folder: Path, nodes: tuple[str, ...] = ("one", "two")) -> Iterator[SlurmCluster]:
    """A cluster that runs until the end of the context."""
    cluster = SlurmCluster(folder, nodes)
    try:
        cluster.start()
        yield cluster
    finally:
        cluster.stop()


def which(program: str) -> str | None:
    """Path of a program; daemons lie where PATH of a user does not look."""
    return shutil.which(program, path=os.pathsep.join([os.environ["PATH"], "/usr/sbin", "/sbin"]))


def wait_until(condition: Callable[[], bool], seconds: float) -> None:
    """Return when the condition is true; fail if it takes longer."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, f"waited {seconds} s in vain"
        time.sleep(0.2)


def _open_files(process: psutil.Process) -> list[str]:
    try:
        return [file.path for file in process.open_files()]
    except psutil.Error:
        return []


def _free_ports(number: int) -> list[int]:
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(number)]
    ports = [server.getsockname()[1] for server in sockets]
    for server in sockets:
        server.close()
    return ports
