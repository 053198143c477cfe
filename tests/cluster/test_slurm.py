"""A study on a Slurm cluster of two nodes with the shipped profile: also if a node is lost and jobs are cancelled."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import psutil
import pytest
from cluster.ball_study import HYDRA, NAME, contents
from cluster.slurm_cluster import COMMANDS, DAEMONS, SlurmCluster, wait_until, which
from project import Project

MISSING = [program for program in (*DAEMONS, *COMMANDS) if which(program) is None]
pytestmark = [
    pytest.mark.slurm,
    pytest.mark.slow,
    pytest.mark.skipif(bool(MISSING), reason=f"no {', '.join(MISSING)}; docs/clusters.md says how to install Slurm"),
    pytest.mark.skipif(not find_spec("snakemake_executor_plugin_slurm"), reason="no Slurm executor; try make cluster"),
]
PROFILE = ("--workflow-profile", "slurm", "--slurm-status-command", "squeue", "--latency-wait", "5")
SECONDS = 1800
"""Until an event; a job waits for others and for Snakemake, which asks for states less and less often."""


def start(project: Project, folder: Path, target: str, *options: str) -> subprocess.Popen:
    """Start a run of the study on Slurm, with results in the folder."""
    arguments = (*PROFILE, "--directory", str(folder), *options, "--config", f"hydra={HYDRA}", "--", target)
    return project.start("snakemake", *arguments)


def jobs(slurm: SlurmCluster, rule: str) -> list[dict[str, str]]:
    """The Slurm jobs of a rule."""
    return [job for job in slurm.jobs() if job.get("Comment", "").startswith(f"rule_{rule}_")]


def wait_for_job(slurm: SlurmCluster, rule: str, run: subprocess.Popen) -> dict[str, str]:
    """Wait until a job of the rule runs."""

    def running() -> list[dict[str, str]]:
        assert run.poll() is None, run.communicate()
        return [job for job in jobs(slurm, rule) if job["JobState"] == "RUNNING"]

    wait_until(lambda: bool(running()), SECONDS)
    return running()[0]


@pytest.fixture(scope="module")
def disturbed(slurm: SlurmCluster, project: Project, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of a run that lost the node of its training, and of which a job was cancelled."""
    folder = tmp_path_factory.mktemp("disturbed")
    run = start(project, folder, "table")
    node = wait_for_job(slurm, "train", run)["BatchHost"]
    slurm.lose_node(node)
    slurm.run("scancel", wait_for_job(slurm, "metrics", run)["JobId"])
    output, errors = run.communicate(timeout=SECONDS)
    assert run.returncode == 0, output + errors
    slurm.start_node(node)
    return folder


def test_the_results_are_those_of_local_jobs(disturbed, local_results):
    assert contents(disturbed / "results" / NAME) == local_results
    assert "table/gamma=0.25.csv" in local_results


def test_a_job_of_a_lost_node_runs_again_on_the_other(disturbed, slurm):
    (job,) = (job for job in jobs(slurm, "train") if job["Restarts"] != "0")
    assert job["JobState"] == "COMPLETED"
    assert job["Restarts"] == "1"


def test_a_cancelled_job_is_submitted_again_with_more_memory(disturbed, slurm):
    cancelled = next(job for job in jobs(slurm, "metrics") if job["JobState"] == "CANCELLED")
    memory = [job["MinMemoryNode"] for job in jobs(slurm, "metrics") if job["Comment"] == cancelled["Comment"]]
    assert memory == ["6000M", "12000M"]


def test_nothing_half_written_is_left(disturbed):
    assert not [file for file in disturbed.rglob("*") if ".part" in file.name or file.suffix == ".checkpoint"]


def test_a_job_gets_a_gpu(disturbed, slurm, project):
    index = f"results/{NAME}/{NAME}/gamma=0.25/alternating/seed=0/frames"
    run = start(project, disturbed, index, "--forcerun", "render", "--set-resources", "render:gres=gpu:1")
    output, errors = run.communicate(timeout=SECONDS)
    assert run.returncode == 0, output + errors
    assert "gres:gpu:1" in jobs(slurm, "render")[-1]["TresPerNode"]


def test_cancelling_the_job_that_snakemake_runs_in_cancels_its_jobs(slurm, project, tmp_path):
    (tmp_path / "carigs").write_text(f'#!/bin/sh\nexec {sys.executable} -m carigs "$@"\n')
    (tmp_path / "carigs").chmod(0o755)
    shutil.copytree(project.root / "conf", tmp_path / "conf")
    submit = ["sbatch", "--parsable", "--output", f"{tmp_path}/head.log", "--chdir", str(tmp_path)]
    environment = ["env", f"PYTHONPATH={project.root}", f"PATH={tmp_path}:{os.environ['PATH']}"]
    script = [str(project.root / "profiles/slurm/run.sh"), HYDRA, "--", *PROFILE[2:]]
    head = slurm.run(*environment, *submit, *script).strip()
    wait_until(lambda: "RUNNING" in states(slurm, "capture"), 60)
    slurm.run("scancel", head)
    wait_until(lambda: states(slurm, "capture")[-1] not in ("RUNNING", "COMPLETING"), 30)
    wait_until(lambda: not [process for process in psutil.process_iter() if str(tmp_path) in _command(process)], 30)
    assert states(slurm, "capture")[-1] == "CANCELLED"


def states(slurm: SlurmCluster, rule: str) -> list[str]:
    """States of the Slurm jobs of a rule."""
    return [job["JobState"] for job in jobs(slurm, rule)]


def _command(process: psutil.Process) -> str:
    try:
        return " ".join(process.cmdline())
    except psutil.Error:
        return ""
