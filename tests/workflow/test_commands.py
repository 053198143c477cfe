"""The command lines that people type."""

from __future__ import annotations

import os
import re
import shutil
import signal
import time

import pytest
import yaml
from project import Project

TARGETS = ("reproduce", "table")


@pytest.mark.slow
def test_a_bare_checkout_can_be_planned(stubbed):
    """One settings file per stage and point, one training per variant, one rendering per variant and level."""
    subjects, variants, levels = 2, 2, 2
    assert stubbed.planned() == {
        "settings": 3 + 7 * subjects + variants * subjects,
        "capture": subjects,
        "exaggerate": subjects,
        "gtstar": subjects,
        "train": subjects * variants,
        "truth": subjects * levels,
        "render": subjects * variants * levels,
        "metrics": subjects * variants * levels,
        "figures": subjects,
        "tabulate": 1,
        "card": 1,
        "report": 1,
    }


@pytest.mark.slow
def test_the_baseline_needs_no_targets(stubbed):
    assert "gtstar" not in stubbed.planned(hydra="study.variants=[surfhead]")


@pytest.mark.slow
def test_targets_are_made_once_for_each_level_and_all_variants_that_share_them(stubbed):
    """Ours and `no_mask` share those at 0.25, and `levels` has them too beside those of three more levels."""
    subjects = 2
    planned = stubbed.planned(hydra="study.variants=[alternating,no_mask,affine,no_relight,levels]")
    assert (planned["gtstar"], planned["train"]) == (subjects * (3 + 3), subjects * 5)


@pytest.mark.slow
def test_seeds_multiply_what_depends_on_the_training_and_nothing_else(stubbed):
    """Trainings, their settings, renderings and metrics."""
    trainings = 4
    once, twice = (stubbed.planned(hydra=f"study.seeds={seeds}") for seeds in ("[0]", "[0,7]"))
    doubled = {rule: 2 * once[rule] for rule in ("train", "render", "metrics")}
    assert twice == {**once, **doubled, "settings": once["settings"] + trainings}


@pytest.mark.slow
def test_a_seed_more_is_a_training_more_and_figures_show_the_first(finished):
    planned = finished.planned(*TARGETS, hydra="study.seeds=[0,7]")
    assert planned == {"settings": 4, "train": 4, "render": 8, "metrics": 8, "tabulate": 1, "card": 1, "report": 1}
    finished.make("table", hydra="study.seeds=[0,7]")
    place = finished.root / "results/toy/toy/gamma=0.25/surfhead"
    assert "seed=7" in (place / "seed=7/avatar.npz").read_text()
    metrics = (finished.root / "results/toy/log/metrics/toy,gamma=0.25,surfhead,seed=7,level=0.log").read_text()
    assert "seed: 7" in metrics.splitlines()
    records = (finished.root / "results/toy/log/tabulate/gamma=0.25.log").read_text()
    assert len(re.findall(r"seed=0/level", records)) == len(re.findall(r"seed=7/level", records)) == 8


@pytest.mark.slow
def test_the_papers_study_can_be_planned_without_its_data(stubbed):
    planned = stubbed.planned(hydra="study=paper")
    assert (planned["capture"], planned["train"], planned["render"]) == (10, 40, 200)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--config", "hydra=train.iteration=3"), ("train.iteration", "iterations")),
        (("--config", "hydra=study=tyo"), ("study=tyo", "toy")),
        (("--config", "hydra=capture.source=sculpture"), ("capture.source=sculpture", "toy or folder")),
        (("--config", "hydra=capture.source=folder"), ("capture.folder must be set",)),
        (("--config", "hydra=train.density.max_surfels=0"), ("train.density.max_surfels=0", "[1, 10000000]")),
        (("--config", "hydra=train.mask_flags=[freckles]"), ("freckles", "occluded")),
        (("--config", "hydra=study.seeds=[1,1]"), ("study.seeds=[1, 1]", "different")),
        (("--config", "hdyra=study=toy"), ("hdyra", "hydra")),
        (("--config", "hydra=metrics.edit_prompt='A nose'"), ("metrics.edit_prompt", "quot")),
        (("results/toy/nobody/capture.json",), ("subject=nobody", "toy")),
        (("results/toy/toy/gamma=0.25/surfhaed/seed=0/avatar.npz",), ("variant=surfhaed", "surfhead")),
        (("results/toy/toy/gamma=0.25/surfhead/seed=0/level=0.3/frames.json",), ("level=0.3", "0.25")),
        (("results/toy/toy/gamma=0.25/surfhead/seed=9999999999/avatar.npz",), ("seed=9999999999", "[0, 4294967295]")),
        (("results/toy/toy/gamma=0.250/surfhead/seed=0/avatar.npz",), ("gamma=0.250",)),
        (("results/paper/toy/capture.json",), ("study=paper", "toy")),
    ],
)
def test_a_mistake_on_the_command_line_ends_the_dry_run_with_its_name(stubbed, arguments, named):
    done = stubbed.command("snakemake", "-n", *arguments)
    assert done.returncode == 1
    assert any(all(word in line for word in named) for line in (done.stdout + done.stderr).splitlines())


@pytest.mark.slow
@pytest.mark.parametrize(
    ("line", "named"),
    [
        ("  iteration: 3", ("train.iteration", "variant/surfhead", "iterations")),
        ("  iterations: many", ("train.iterations", "variant/surfhead", "many")),
        ("train: {}", ("surfhead.yaml", "train")),
    ],
)
def test_a_mistake_in_a_file_ends_the_dry_run_though_every_result_is_there(finished, line, named):
    finished.edit("conf/variant/surfhead.yaml", add=line)
    done = finished.command("snakemake", "-n")
    assert done.returncode == 1
    assert any(all(word in text for word in named) for text in (done.stdout + done.stderr).splitlines())


@pytest.mark.slow
def test_what_is_the_inputs_fault_is_told_in_one_line_and_in_the_log(stubbed):
    target = "results/broken/toy/capture.json"
    done = stubbed.snakemake("--cores", "1", target, hydra="study.name=broken capture.folder=broken")
    line = f"carigs: {target}: capture.folder=broken is no dataset"
    assert done.returncode == 1
    assert line in (done.stdout + done.stderr).splitlines()
    assert "Traceback" not in done.stdout + done.stderr
    assert (stubbed.root / "results/broken/log/capture/toy.log").read_text().splitlines()[-1] == line


@pytest.mark.slow
def test_the_last_line_of_a_run_that_failed_is_the_error(stubbed):
    options = ["study.name=failed", "capture.folder=broken", "study.subjects=[toy]", "--target", "table"]
    done = stubbed.command("carigs", "run", *options)
    assert done.returncode == 1
    error = "results/failed/toy/capture.json: capture.folder=broken is no dataset"
    assert done.stderr.splitlines()[-1] == f"carigs: {error} (results/failed/log/capture/toy.log)"


@pytest.mark.slow
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
    assert requests == dict.fromkeys(("capture", "exaggerate", "gtstar", "truth", "render"), small) | {
        "train": large,
        "metrics": large,
    }


@pytest.mark.slow
def test_a_stage_gets_its_settings_files_and_wildcards(made):
    log = (made.root / "results/toy/log/metrics/twin,gamma=0.25,surfhead,seed=0,level=0.25.log").read_text()
    point = "results/toy/twin/gamma=0.25"
    for line in (
        f"frames: PosixPath('{point}/surfhead/seed=0/level=0.25/frames')",
        f"truth: PosixPath('{point}/truth/level=0.25/truth.json')",
        "subject: 'twin'",
        "variant: 'surfhead'",
        "gamma: 0.25",
        "level: 0.25",
    ):
        assert line in log.splitlines()
    assert "watch" not in log
    assert "code" not in log
    assert "targets: None" in (made.root / "results/toy/log/train/twin,gamma=0.25,surfhead,seed=0.log").read_text()


@pytest.mark.slow
def test_figures_know_which_image_is_which(made):
    log = (made.root / "results/toy/log/figures/twin,gamma=0.25.log").read_text()
    indices = re.findall(r"/(\w+)/seed=0/level=([\d.]+)/frames.json", log)
    assert indices == [("alternating", "0"), ("alternating", "0.25"), ("surfhead", "0"), ("surfhead", "0.25")]
    assert "variants: ['alternating', 'alternating', 'surfhead', 'surfhead']" in log
    assert "levels: [0.0, 0.25, 0.0, 0.25]" in log
    assert "truth_levels: [0.0, 0.25]" in log


@pytest.mark.slow
def test_a_killed_run_goes_on_where_it_was(stubbed, tmp_path):
    project = Project(tmp_path / "project")
    shutil.copytree(stubbed.root, project.root, symlinks=True)
    hydra = "study.subjects=[toy] study.variants=[surfhead]"
    project.make("results/toy/toy/capture.json", hydra=hydra)
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
    assert project.command("snakemake", "--unlock").returncode == 0
    assert project.planned("table", hydra=hydra)["exaggerate"] == 1
    project.make("table", hydra=hydra)
    assert (project.root / "results/toy/table/gamma=0.25.csv").is_file()
    assert (project.root / "results/toy/toy/capture.json").stat().st_mtime_ns == dataset


@pytest.mark.slow
def test_a_run_prints_a_line_per_job_and_where_the_results_are(finished):
    """Settings are written without a line."""
    done = finished.command("carigs", "run", "--cores", "1", "tabulate.confidence=0.9")
    assert done.returncode == 0, done.stdout + done.stderr
    jobs = [line for line in done.stderr.splitlines() if " done] " in line]
    assert [re.sub(r"^\[.*\] ", "", line) for line in jobs] == [
        "tabulate: results/toy/table/gamma=0.25.csv",
        "card: results/toy/card.json",
        "report: results/toy/report.html",
    ]
    places = ("table/gamma=0.25.md", "figures", "card.md", "report.html")
    assert done.stderr.splitlines()[-4:] == [f"carigs: results/toy/{place}" for place in places]
    assert "jobid" not in done.stderr
    assert "jobid" in max((finished.root / ".snakemake/log").iterdir()).read_text()


@pytest.mark.slow
def test_a_run_repeats_the_warnings_of_its_jobs(finished):
    (finished.root / "results/toy/table/gamma=0.25.csv").unlink()
    done = finished.snakemake("--cores", "1", "table")
    assert done.returncode == 0, done.stdout + done.stderr
    (line,) = {line for line in done.stderr.splitlines() if line.startswith("carigs: warning: ")}
    assert re.fullmatch(r".*: no weights of this network \(results/toy/log/metrics/.*\.log and 7 more\)", line)


@pytest.mark.slow
def test_a_sweep_adds_to_what_is_there(finished):
    results = finished.root / "results"
    before = {file: file.stat().st_mtime_ns for file in results.rglob("*") if file.is_file()}
    done = finished.command("carigs", "sweep", "gamma=0.2,0.25", "study.subjects=[toy]", "study.variants=[surfhead]")
    assert done.returncode == 0, done.stdout + done.stderr
    assert {file.name for file in (results / "toy/table").glob("*.csv")} == {"gamma=0.2.csv", "gamma=0.25.csv"}
    touched = {file for file, time in before.items() if file.stat().st_mtime_ns != time}
    # At 0.25 a subject and a variant are left out: table, figures, card and report are made again, and nothing else is.
    assert all(re.search("table|tabulate|figures|card|report", str(file.relative_to(results))) for file in touched)
    assert not (finished.root / "outputs").exists()
    assert not (finished.root / "multirun").exists()


@pytest.mark.slow
def test_a_point_of_a_sweep_that_fails_does_not_keep_the_others_from_running(finished):
    done = finished.command("carigs", "sweep", "capture.folder=broken,null", "study.subjects=[toy]")
    assert done.returncode == 1
    assert "failed: capture.folder=broken study.subjects=[toy]" in done.stderr
    assert (finished.root / "results/toy/table/gamma=0.25.csv").is_file()


def test_all_settings_can_be_shown(stubbed):
    shown = yaml.safe_load(stubbed.command("carigs", "settings", "gamma=0.2").stdout)
    assert shown["gamma"] == 0.2
    assert set(shown) == {"gamma", "seed", "study"} | {
        "capture", "exaggerate", "gtstar", "train", "render", "truth", "metrics", "tabulate", "figures",
        "card", "report",
    }  # fmt: skip


@pytest.mark.slow
def test_the_workflow_has_no_lint(stubbed):
    done = stubbed.command("snakemake", "--lint")
    assert done.returncode == 0, done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize(
    "override",
    ["study.variants=[surfhead]", "metrics.edit_prompt='A nose, \"large\"'", "metrics.edit_prompt=A head's nose"],
)
def test_an_override_reaches_snakemake_as_it_was_typed(stubbed, override):
    done = stubbed.command("carigs", "run", "--dry-run", override)
    # The last one is an error of Hydra's grammar, told with its text; the others are planned.
    assert (done.returncode == 0) == ("head's" not in override), done.stdout + done.stderr
    assert "No closing quotation" not in done.stdout + done.stderr


@pytest.mark.slow
@pytest.mark.parametrize("overrides", [[], ["gamma=0.2"], ["gamma=0.2", "train.iterations=7"]])
def test_a_study_runs_with_any_number_of_overrides(stubbed, overrides):
    done = stubbed.command("carigs", "run", "--dry-run", *overrides)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"^train +4$", done.stdout, re.MULTILINE)
    assert "jobid" not in done.stdout  # no description of each job
