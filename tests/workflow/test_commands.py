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
    """One settings file per stage and point, one training per variant, one rendering per training."""
    subjects, variants, levels = 2, 2, 2
    assert stubbed.planned() == {
        "settings": 3 + 10 * subjects + variants * subjects,
        "capture": subjects,
        "hair": subjects,
        "exaggerate": subjects,
        "gtstar": subjects,
        "target_sheet": subjects,
        "train": subjects * variants,
        "html": subjects,
        "truth": subjects * levels,
        "render": subjects * variants,
        "metrics": subjects * variants,
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
    assert planned == {"settings": 4, "train": 4, "render": 4, "metrics": 4, "tabulate": 1, "card": 1, "report": 1}
    finished.make("table", hydra="study.seeds=[0,7]")
    place = finished.root / "results/toy/toy/gamma=0.25/surfhead"
    assert "seed=7" in (place / "seed=7/avatar.npz").read_text()
    metrics = (finished.root / "results/toy/log/metrics/toy,gamma=0.25,surfhead,seed=7.log").read_text()
    assert "seed: 7" in metrics.splitlines()
    records = (finished.root / "results/toy/log/tabulate/gamma=0.25.log").read_text()
    assert len(re.findall(r"seed=0/metrics", records)) == len(re.findall(r"seed=7/metrics", records)) == 4


@pytest.mark.slow
def test_the_papers_study_can_be_planned_without_its_data(stubbed):
    planned = stubbed.planned(hydra="study=paper")
    assert (planned["capture"], planned["train"], planned["render"]) == (10, 40, 40)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "named"),
    [
        (("--config", "hydra=train.iteration=3"), ("train.iteration", "iterations")),
        (("--config", "hydra=study=tyo"), ("study=tyo", "toy")),
        (("--config", "hydra=capture.source=sculpture"), ("capture.source=sculpture", "toy, folder or video")),
        (("--config", "hydra=capture.source=folder"), ("capture.folder must be set",)),
        (("--config", "hydra=train.density.max_surfels=0"), ("train.density.max_surfels=0", "[1, 10000000]")),
        (("--config", "hydra=train.mask_flags=[freckles]"), ("freckles", "occluded")),
        (("--config", "hydra=study.seeds=[1,1]"), ("study.seeds=[1, 1]", "different")),
        (("--config", "hdyra=study=toy"), ("hdyra", "hydra")),
        (("--config", "hydra=metrics.edit_prompt='A nose'"), ("metrics.edit_prompt", "quot")),
        (("results/toy/nobody/capture.json",), ("subject=nobody", "toy")),
        (("results/toy/toy/gamma=0.25/surfhaed/seed=0/avatar.npz",), ("variant=surfhaed", "surfhead")),
        (("results/toy/toy/gamma=0.25/truth/level=0.3/truth.json",), ("level=0.3", "0.25")),
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
    subject_stages = ("capture", "hair", "exaggerate", "gtstar", "target_sheet", "html", "truth", "render")
    assert requests == dict.fromkeys(subject_stages, small) | {
        "train": large,
        "metrics": large,
    }


@pytest.mark.slow
def test_a_stage_gets_its_settings_files_and_wildcards(made):
    log = (made.root / "results/toy/log/metrics/twin,gamma=0.25,surfhead,seed=0.log").read_text()
    point = "results/toy/twin/gamma=0.25"
    truths = (f"PosixPath('{point}/truth/level={level}/truth.json')" for level in ("0", "0.25"))
    for line in (
        f"frames: PosixPath('{point}/surfhead/seed=0/frames')",
        f"truths: [{', '.join(truths)}]",
        "subject: 'twin'",
        "variant: 'surfhead'",
        "gamma: 0.25",
        "levels: [0.0, 0.25]",
    ):
        assert line in log.splitlines()
    assert "watch" not in log
    assert "code" not in log
    assert "targets: None" in (made.root / "results/toy/log/train/twin,gamma=0.25,surfhead,seed=0.log").read_text()


@pytest.mark.slow
def test_figures_know_which_image_is_which(made):
    log = (made.root / "results/toy/log/figures/twin,gamma=0.25.log").read_text()
    assert re.findall(r"/(\w+)/seed=0/frames", log) == ["alternating", "surfhead"]
    assert re.findall(r"/truth/level=([\d.]+)/truth.json", log) == ["0", "0.25"]
    assert "variants: ['alternating', 'surfhead']" in log and "levels: [0.0, 0.25]" in log


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
def test_a_run_repeats_the_warnings_of_its_jobs(finished):
    (finished.root / "results/toy/table/gamma=0.25.csv").unlink()
    done = finished.snakemake("--cores", "1", "table")
    assert done.returncode == 0, done.stdout + done.stderr
    (line,) = {line for line in done.stderr.splitlines() if line.startswith("carigs: warning: ")}
    assert re.fullmatch(r".*: no weights of this network \(results/toy/log/metrics/.*\.log and 3 more\)", line)


def sweep(project, *arguments):
    """Run `carigs sweep` for one subject and variant at one level; fails with all that it says."""
    small = ("study.subjects=[toy]", "study.variants=[surfhead]", "study.levels=[]")
    done = project.command("carigs", "sweep", *arguments, *small)
    assert done.returncode == 0, done.stdout + done.stderr
    return done


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.slow
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


def test_all_settings_can_be_shown(stubbed):
    shown = yaml.safe_load(stubbed.command("carigs", "settings", "gamma=0.2").stdout)
    assert shown["gamma"] == 0.2
    assert set(shown) == {"gamma", "study", "regions"} | {
        "track", "capture", "hair", "exaggerate", "gtstar", "target_sheet", "train", "render", "html", "truth",
        "metrics", "tabulate", "figures", "sweep", "card", "report",
    }  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("config", ["hydra=", "sweep=gamma=0.1,0.2"])
def test_the_workflow_has_no_lint(stubbed, config):
    done = stubbed.command("snakemake", "--lint", "--config", config)
    assert done.returncode == 0, done.stdout + done.stderr


ODD_TEXTS = (
    "results/toy/toy/gamma=0.25/alternating/seed=0/avatar.npz",
    'data (1)/it\'s "#1"! ~{a}$HOME%$(id)`id`&;|<>*?[b]: c #d\\ü😀',
)
"""Names of files with what Hydra, YAML, Snakemake, Python's formats and shells take for something else."""


@pytest.mark.slow
@pytest.mark.parametrize("text", ODD_TEXTS)
def test_a_text_reaches_the_job_as_it_was_typed(stubbed, tmp_path, text, monkeypatch):
    monkeypatch.setenv("SECRET", "told")
    project = Project(tmp_path / "project")
    shutil.copytree(stubbed.root, project.root, symlinks=True)
    options = ["study.subjects=[toy]", "study.variants=[surfhead]", "--target", "table", "--cores", "2"]
    prompt = r"metrics.edit_prompt=\${oc.env:SECRET}"
    done = project.command("carigs", "run", *options, f"train.start={text}", prompt)
    assert done.returncode == 0, done.stdout + done.stderr
    (train,), (metrics,) = (
        [*(project.root / "results/toy/log" / stage).glob("*.log")] for stage in ("train", "metrics")
    )
    assert f"start={text!r}" in train.read_text()
    assert "edit_prompt='${oc.env:SECRET}'" in metrics.read_text() and "told" not in metrics.read_text()


@pytest.mark.slow
@pytest.mark.parametrize("overrides", [[], ["gamma=0.2"], ["gamma=0.2", "train.iterations=7"]])
def test_a_study_runs_with_any_number_of_overrides(stubbed, overrides):
    done = stubbed.command("carigs", "run", "--dry-run", *overrides)
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"^train +4$", done.stdout, re.MULTILINE)
    assert "jobid" not in done.stdout  # no description of each job
