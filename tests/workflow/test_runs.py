"""What a run says of its jobs, and what becomes of it if they fail or it is killed."""

from __future__ import annotations

import os
import re
import shutil
import signal
import time

import pytest
from project import Project

pytestmark = pytest.mark.slow


def test_what_is_the_inputs_fault_is_told_in_one_line_and_in_the_log(stubbed):
    target = "results/broken/toy/capture.json"
    done = stubbed.snakemake("--cores", "1", target, hydra="study.name=broken capture.folder=broken")
    line = f"carigs: {target}: capture.folder=broken is no dataset"
    assert done.returncode == 1
    assert line in (done.stdout + done.stderr).splitlines()
    assert "Traceback" not in done.stdout + done.stderr
    assert (stubbed.root / "results/broken/log/capture/toy.log").read_text().splitlines()[-1] == line


def test_the_last_line_of_a_run_that_failed_is_the_error(stubbed):
    options = ["study.name=failed", "capture.folder=broken", "study.subjects=[toy]", "--target", "table"]
    done = stubbed.command("carigs", "run", *options)
    assert done.returncode == 1
    error = "results/failed/toy/capture.json: capture.folder=broken is no dataset"
    assert done.stderr.splitlines()[-1] == f"carigs: {error} (results/failed/log/capture/toy.log)"


def test_a_job_is_tried_again_with_twice_the_memory(stubbed, tmp_path):
    project = Project(tmp_path / "project")
    shutil.copytree(stubbed.root, project.root, symlinks=True)
    (project.root / "fail_once").mkdir()
    hydra = "study.subjects=[toy] study.variants=[alternating] study.levels=[]"
    done = project.snakemake("--cores", "2", "--retries", "1", "--verbose", "reproduce table", hydra=hydra)
    assert done.returncode == 0, done.stdout + done.stderr
    started = r"^(?:local)?rule (\w+):\n(?: +.*\n)*? +resources: .*\bmem_mb=(\d+)"
    requests: dict[str, set[int]] = {}
    for rule, megabytes in re.findall(started, done.stdout + done.stderr, re.MULTILINE):
        requests.setdefault(rule, set()).add(int(megabytes))
    small, large = {4000, 8000}, {6000, 12000}
    subject_stages = ("capture", "hair", "exaggerate", "gtstar", "target_sheet", "html", "truth", "render")
    assert requests == dict.fromkeys(subject_stages, small) | {
        "train": large,
        "metrics": large,
    }


def test_a_killed_run_goes_on_where_it_was(stubbed, tmp_path):
    project = Project(tmp_path / "project")
    shutil.copytree(stubbed.root, project.root, symlinks=True)
    hydra = "study.subjects=[toy] study.variants=[surfhead]"
    project.make("results/toy/toy/capture.json", "results/toy/toy/hair.npz", hydra=hydra)
    dataset = (project.root / "results/toy/toy/capture.json").stat().st_mtime_ns
    (project.root / "hold").touch()
    running = project.start("snakemake", "--cores", "1", "--config", f"hydra={hydra}", "--", "table")
    path = project.root / "results/toy/toy/gamma=0.25/path.npz"
    for _ in range(300):
        if path.exists():
            break
        time.sleep(0.1)
    os.killpg(running.pid, signal.SIGKILL)
    running.communicate()
    assert path.exists()  # written, but not finished
    (project.root / "hold").unlink()
    assert project.planned("table", hydra=hydra)["exaggerate"] == 1
    project.make("table", hydra=hydra)
    assert (project.root / "results/toy/table/gamma=0.25.csv").is_file()
    assert (project.root / "results/toy/toy/capture.json").stat().st_mtime_ns == dataset


def test_a_run_prints_a_line_per_job_and_where_the_results_are(finished):
    """Settings are written without a line."""
    done = finished.command("carigs", "run", "--cores", "1", "tabulate.reference=surfhead")
    assert done.returncode == 0, done.stdout + done.stderr
    jobs = [line for line in done.stderr.splitlines() if " done] " in line]
    assert [re.sub(r"^\[.*\] ", "", line) for line in jobs] == [
        "starting tabulate: results/toy/table/gamma=0.25.csv",
        "starting card: results/toy/card.json",
        "starting report: results/toy/report.html",
    ]
    pages = [f"{subject}/gamma=0.25/alternating/seed=0/avatar.html" for subject in ("toy", "twin")]
    places = ("table/gamma=0.25.md", "figures", "card.md", "report.html", *pages)
    assert done.stderr.splitlines()[-6:] == [f"carigs: results/toy/{place}" for place in places]
    assert "jobid" not in done.stderr
    assert "jobid" in max((finished.root / ".snakemake/log").iterdir()).read_text()


def test_a_run_repeats_the_warnings_of_its_jobs(finished):
    (finished.root / "results/toy/table/gamma=0.25.csv").unlink()
    done = finished.snakemake("--cores", "1", "table")
    assert done.returncode == 0, done.stdout + done.stderr
    (line,) = {line for line in done.stderr.splitlines() if line.startswith("carigs: warning: ")}
    assert re.fullmatch(r".*: no weights of this network \(results/toy/log/metrics/.*\.log and 3 more\)", line)
