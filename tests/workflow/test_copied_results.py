"""Results without Snakemake's notes: a run compares the settings, code and inputs that made them."""

from __future__ import annotations

import shutil

import pytest
from project import Project

TARGETS = ("reproduce", "table")
POINT = "results/toy/toy/gamma=0.25"
SUMMARIES = {"tabulate": 1, "card": 1, "report": 1}
ALTERNATING = {"train": 2, "html": 2, "render": 2, "metrics": 2, "figures": 2, **SUMMARIES}
pytestmark = pytest.mark.slow


@pytest.fixture
def copied(finished: Project, tmp_path) -> Project:
    """The results alone, copied without modification times, beside another checkout of the same code."""
    shutil.rmtree(finished.root / ".snakemake")
    shutil.copytree(finished.root / "results", tmp_path / "copy", copy_function=shutil.copyfile)
    shutil.rmtree(finished.root / "results")
    (tmp_path / "copy").rename(finished.root / "results")
    return finished


def test_a_copy_is_up_to_date(copied):
    assert copied.planned(*TARGETS) == {}


def test_other_settings_make_it_again(copied):
    """Though the file of settings is there, and the avatar alone is missing."""
    (copied.root / f"{POINT}/alternating/seed=0/avatar.npz").unlink()
    hydra = "train.iterations=7"
    expected = {"settings": 4, **{rule: 2 * n for rule, n in ALTERNATING.items()}, "html": 2, "figures": 2, **SUMMARIES}
    assert copied.planned(*TARGETS, hydra=hydra) == expected
    done = copied.snakemake("--cores", "2", " ".join(TARGETS), hydra=hydra)
    assert done.returncode == 0, done.stdout + done.stderr
    assert "carigs: results/toy: train: 4 results were made with other settings" in done.stderr
    for file in (copied.root / "results/toy").glob("*/gamma=0.25/*/seed=0/avatar.npz"):
        assert "iterations=7" in file.read_text()
    assert copied.planned(*TARGETS, hydra=hydra) == {}


def test_a_plan_with_other_settings_changes_nothing(copied):
    assert copied.planned(*TARGETS, hydra="train.iterations=7") != {}
    assert copied.planned(*TARGETS) == {}


def test_other_code_makes_it_again(copied):
    copied.edit("carigs/stages/render.py", add="more = 1")
    assert copied.planned(*TARGETS) == {"render": 4, "metrics": 4, "figures": 2, **SUMMARIES}


@pytest.mark.parametrize(("kept", "notes"), [(0, True), (0.5, False)])
def test_a_damaged_settings_file_never_means_defaults(finished, kept, notes):
    file = finished.root / "results/toy/settings/train/subject=toy,variant=alternating,seed=0.yaml"
    whole = file.read_text()
    file.write_text(whole[: int(len(whole) * kept)])
    if not notes:
        shutil.rmtree(finished.root / ".snakemake")
    assert finished.planned(*TARGETS) == {
        "settings": 1, "train": 1, "html": 1, "render": 1, "metrics": 1, "figures": 1, **SUMMARIES
    }  # fmt: skip
    finished.make(*TARGETS)
    assert file.read_text() == whole


def test_an_output_of_other_inputs_is_made_again(copied):
    """An interrupted run has made one output again; the copy has lost the order of times."""
    copied.make(f"{POINT}/path.npz", hydra="exaggerate.curvature_floor=0.2")
    shutil.rmtree(copied.root / ".snakemake")
    for file in (copied.root / "results").rglob("*"):
        file.touch()
    planned = copied.planned(*TARGETS, hydra="exaggerate.curvature_floor=0.2")
    assert planned["train"] == planned["gtstar"] * 2 == 4
