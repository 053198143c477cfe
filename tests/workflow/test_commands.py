"""The command lines that people type."""

from __future__ import annotations

import re
import shutil

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
