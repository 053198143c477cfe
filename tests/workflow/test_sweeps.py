"""Sweeps over values of settings: what is planned, made, kept and told."""

from __future__ import annotations

import re
import shutil

import pytest
import yaml
from project import Project

pytestmark = pytest.mark.slow


def sweep(project, *arguments):
    """Run `carigs sweep` for one subject and variant at one level; fails with all that it says."""
    small = ("study.subjects=[toy]", "study.variants=[surfhead]", "study.levels=[]")
    done = project.command("carigs", "sweep", *arguments, *small)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


def test_a_sweep_is_planned_as_a_whole(stubbed):
    """Two gammas share capture and settings; each of the four combinations has trainings and a table."""
    swept = ("--config", "hydra=study.subjects=[toy]", "sweep=gamma=0.1,0.2 train.iterations=10,20 ", "--", "sweep")
    done = stubbed.command("snakemake", "-n", *swept)
    assert done.returncode == 0, done.stdout + done.stderr
    planned = dict(re.findall(r"^(\w+) +(\d+)$", done.stdout, re.MULTILINE))
    variants, combinations = 2, 4
    expected = {
        "capture": 2, "hair": 2, "exaggerate": 4, "gtstar": 4, "train": combinations * variants,
        "metrics": combinations * variants, "tabulate": combinations, "sweep": 1,
    }  # fmt: skip
    assert {rule: int(planned[rule]) for rule in expected} == expected
    assert not {"card", "report", "figures"} & planned.keys()


def test_a_sweep_adds_to_what_is_there(finished):
    """At 0.25 a subject and a variant are left out: the table is made again, and nothing else is."""
    results = finished.root / "results"
    before = {file: file.stat().st_mtime_ns for file in results.rglob("*") if file.is_file()}
    done = sweep(finished, "gamma=0.2,0.25")
    assert {file.name for file in (results / "toy/table").glob("*.csv")} == {"gamma=0.2.csv", "gamma=0.25.csv"}
    made = [f"carigs: results/toy/sweep/gamma.{suffix}" for suffix in ("md", "csv", "png", "pdf")]
    assert done.stderr.splitlines()[-4:] == made
    touched = {file for file, time in before.items() if file.stat().st_mtime_ns != time}
    assert not [f for f in touched if not re.search("table|tabulate", str(f.relative_to(results)))]
    assert not (finished.root / "outputs").exists()
    assert not (finished.root / "multirun").exists()


def test_a_sweep_that_is_made_is_not_made_again_and_a_new_value_adds_its_own_jobs(stubbed, tmp_path):
    project = Project(tmp_path / "project")
    shutil.copytree(stubbed.root, project.root, symlinks=True)
    sweep(project, "train.iterations=10,20", "capture.toy.seed=1,2", "--cores", "2")
    folders = {f"toy+capture.toy.seed={seed},train.iterations={steps}" for steps in (10, 20) for seed in (1, 2)}
    assert {folder.name for folder in (project.root / "results").glob("toy*")} == {"toy", *folders}
    # The values in another order, and the keys: the studies are the same, the table has another order.
    assert "Nothing to be done" in sweep(project, "train.iterations=10,20", "capture.toy.seed=1,2", "--dry-run").stdout
    planned = sweep(project, "capture.toy.seed=2,1", "train.iterations=20,10", "--dry-run").stdout
    assert re.search(r"^sweep +1$", planned, re.MULTILINE) and not re.search(
        r"^(train|tabulate) ", planned, re.MULTILINE
    )
    planned = sweep(project, "train.iterations=10,20,30", "capture.toy.seed=1,2", "--dry-run").stdout
    assert re.search(r"^train +2$", planned, re.MULTILINE) and re.search(r"^sweep +1$", planned, re.MULTILINE)
    # The results of a study without a sweep are others.
    assert not (project.root / "results/toy/toy").exists()


def test_a_combination_that_fails_does_not_stop_the_others(finished):
    done = finished.command("carigs", "sweep", "capture.folder=broken,null", "study.subjects=[toy]")
    assert done.returncode == 1
    line = "carigs: failed: capture.folder=broken; the others are kept for the next run"
    assert done.stderr.splitlines()[-1] == line
    assert (finished.root / "results/toy+capture.folder=null/table/gamma=0.25.csv").is_file()
    assert not (finished.root / "results/toy/sweep").exists()
    # Without it, the rest is there.
    done = finished.command("carigs", "sweep", "capture.folder=null,null", "study.subjects=[toy]")
    assert done.returncode == 0, done.stdout + done.stderr
    assert [line for line in done.stderr.splitlines() if " done] " in line] == [
        "[0 of 1 done] starting sweep: results/toy/sweep/capture.folder.csv"
    ]


@pytest.mark.parametrize(
    ("swept", "named"),
    [
        ("train.iteration=3,4", ("train.iteration", "iterations")),
        ("gamma=0.1,0", ("gamma=0 ", "0.0001")),
        ("capture.toy.seed=range(20000)", ("at most 10000 combinations",)),
        ("metrics.edit_prompt='A nose", ("sweep=", "quot")),
    ],
)
def test_a_mistake_in_the_values_of_a_sweep_ends_the_dry_run_with_its_name(stubbed, swept, named):
    done = stubbed.command("snakemake", "-n", "--config", f"sweep={swept}", "--", "sweep")
    assert done.returncode == 1
    assert any(all(word in line for word in named) for line in (done.stdout + done.stderr).splitlines())


def test_any_number_of_overrides_reaches_the_jobs(stubbed, tmp_path):
    """More than the command of a job can hold: Linux allows a word of 128 KiB."""
    project = Project(tmp_path / "project")
    shutil.copytree(stubbed.root, project.root, symlinks=True)
    long = [f"metrics.edit_prompt={'a' * 2000}" for _ in range(100)]
    seeds = [f"capture.toy.seed={seed}" for seed in range(100)]
    done = sweep(project, *long, *seeds, "train.iterations=10,20")
    assert done.stderr.splitlines()[-1] == "carigs: results/toy/sweep/train.iterations.pdf"
    (folder,) = (project.root / "results").glob("*=20/settings")
    capture, train = (
        yaml.safe_load(next((folder / stage).glob("*.yaml")).read_text()) for stage in ("capture", "train")
    )
    assert (capture["toy"]["seed"], train["iterations"]) == (99, 20)
