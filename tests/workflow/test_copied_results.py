"""Results without Snakemake's notes: a run compares the settings, code and inputs that made them."""

from __future__ import annotations

import os
import shutil
import time
from pathlib import Path

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
    expected = {**{rule: 2 * n for rule, n in ALTERNATING.items()}, "html": 2, "figures": 2, **SUMMARIES}
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
    """It is written again; what was made with the whole one is kept."""
    file = finished.root / "results/toy/settings/train/subject=toy,variant=alternating,seed=0.yaml"
    whole = file.read_text()
    file.write_text(whole[: int(len(whole) * kept)])
    if not notes:
        shutil.rmtree(finished.root / ".snakemake")
    assert finished.planned(*TARGETS) == {}
    (finished.root / f"{POINT}/alternating/seed=0/avatar.npz").unlink()
    finished.make(*TARGETS)
    assert file.read_text() == whole


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-1])


def halve(file: Path) -> None:
    """As many bytes, with other values."""
    file.write_bytes(bytes(value // 2 for value in file.read_bytes()))
    os.utime(file, ns=(0, file.stat().st_mtime_ns + 10**12))


def empty(file: Path) -> None:
    file.write_bytes(b"")


AVATAR, FRAME = f"{POINT}/alternating/seed=0/avatar.npz", f"{POINT}/surfhead/seed=0/frames/ablation.png"
MADE_FROM = {
    AVATAR: {"train", "html", "render", "metrics", "figures", *SUMMARIES},
    f"{POINT}/path.npz": {"exaggerate", "gtstar", "target_sheet", "truth"} | ALTERNATING.keys(),
    "results/toy/toy/capture.json": {
        "capture", "hair", "exaggerate", "gtstar", "target_sheet", "truth", *ALTERNATING.keys()
    },
    FRAME: {"render", "metrics", "figures", *SUMMARIES},
    "results/toy/table/gamma=0.25.tex": {*SUMMARIES},
    "results/toy/report.html": {"report"},
}  # fmt: skip
"""What is made again if a file is damaged."""


@pytest.mark.parametrize(
    ("file", "damage"),
    # How a file is damaged has nothing to do with which one it is: a file, and one in a folder, have all damages.
    [*((file, halve) for file in MADE_FROM), (AVATAR, cut), (AVATAR, empty), (FRAME, cut), (FRAME, empty)],
)
def test_one_damaged_file_is_made_again_and_the_rest_kept(finished, file, damage):
    """With Snakemake's notes: the file is damaged in place."""
    damage(finished.root / file)
    assert set(finished.planned(*TARGETS)) == MADE_FROM[file]


def test_a_damaged_copy_is_made_again_to_the_same_bytes(copied):
    file = copied.root / f"{POINT}/alternating/seed=0/avatar.npz"
    whole = file.read_bytes()
    halve(file)
    copied.make(*TARGETS)
    assert file.read_bytes() == whole
    assert copied.planned(*TARGETS) == {}


def test_a_dry_run_changes_nothing(copied):
    """Neither contents nor modification times, even if everything is outdated and processes have left files."""
    (copied.root / f"{POINT}/.a.1-1-00000000-nowhere.part.npz").touch()
    (copied.root / "results/toy/log/train/left.lock").touch()
    copied.edit("carigs/stages/train.py", add="more = 1")
    before = states(copied)
    assert copied.planned(*TARGETS, hydra="exaggerate.curvature_floor=0.2")["train"] == 4
    assert states(copied) == before


def states(project: Project) -> dict[Path, tuple[int, int, int]]:
    found = {path: path.lstat() for path in (project.root / "results").rglob("*")}
    return {path: (status.st_mtime_ns, status.st_size, status.st_ino) for path, status in found.items()}


def test_two_working_folders_share_results(finished, tmp_path):
    """The second folder has other settings: what it finds in the results of the first one is not what it asks for."""
    second = Project(tmp_path / "second")
    shutil.copytree(finished.root, second.root, ignore=shutil.ignore_patterns("results", ".snakemake"))
    (second.root / "results").symlink_to(finished.root / "results")
    assert second.planned(*TARGETS) == {}
    avatar = finished.root / f"{POINT}/alternating/seed=0/avatar.npz"
    second.make(f"{POINT}/alternating/seed=0/avatar.npz", hydra="train.iterations=7")
    assert "iterations=7" in avatar.read_text()
    assert finished.planned(*TARGETS)["train"] == 1
    finished.make(*TARGETS)
    assert "iterations=7" not in avatar.read_text()


def test_results_of_another_run_count_more_than_notes_of_the_last_one_here(finished, tmp_path):
    """Results are put back as they were before a run with other settings."""
    shutil.copytree(finished.root / "results", tmp_path / "before")
    avatar = f"{POINT}/alternating/seed=0/avatar.npz"
    finished.make(avatar, hydra="train.iterations=7")
    shutil.rmtree(finished.root / "results")
    (tmp_path / "before").rename(finished.root / "results")
    assert finished.planned(*TARGETS) == {}
    assert finished.planned(avatar, hydra="train.iterations=7") == {"train": 1}


@pytest.mark.parametrize("kind", ["a folder for a file", "a file for a folder"])
def test_an_output_of_another_kind_is_made_again(finished, kind):
    folder = finished.root / f"{POINT}/alternating/seed=0"
    if kind == "a folder for a file":
        (folder / "avatar.npz").unlink()
        (folder / "avatar.npz/inside").mkdir(parents=True)
    else:
        shutil.rmtree(folder / "frames")
        (folder / "frames").touch()
    finished.make(*TARGETS)
    assert (folder / "avatar.npz").is_file() and (folder / "frames").is_dir()


def test_code_that_is_edited_while_a_run_goes_on_makes_no_current_result(finished):
    """Put back afterwards, it is what the records would name."""
    (finished.root / f"{POINT}/path.npz").unlink()
    (finished.root / "hold").touch()
    running = finished.start("snakemake", "--cores", "1", f"{POINT}/alternating/seed=0/avatar.npz", "-R", "exaggerate")
    while not (finished.root / f"{POINT}/path.npz").exists() and running.poll() is None:
        time.sleep(0.1)
    file = finished.root / "carigs/stages/gtstar.py"
    before = file.read_text()
    finished.edit("carigs/stages/gtstar.py", add="more = 1")
    (finished.root / "hold").unlink()
    said = "".join(running.communicate())
    assert running.returncode != 0 and "the code of this stage was edited" in said
    file.write_text(before)
    assert "gtstar" in finished.planned(*TARGETS)


def test_two_runs_of_a_study_at_once_are_refused(finished, tmp_path):
    """Also from another working folder, where Snakemake's own lock is not seen."""
    second = Project(tmp_path / "second")
    shutil.copytree(finished.root, second.root, ignore=shutil.ignore_patterns("results", ".snakemake"))
    (second.root / "results").symlink_to(finished.root / "results")
    (finished.root / "hold").touch()
    (finished.root / "results/toy/report.html").unlink()
    first = finished.start("snakemake", "--cores", "1", "reproduce")
    lock = finished.root / "results/toy/log/run.lock"
    while not lock.exists() and first.poll() is None:
        time.sleep(0.1)
    for arguments in (["reproduce"], ["--delete-all-output", "reproduce"]):
        refused = second.snakemake("--cores", "1", *arguments, hydra="train.iterations=7")
        assert refused.returncode != 0
        (line,) = [line for line in refused.stderr.splitlines() if "run.lock" in line]
        assert line.startswith("carigs: results/toy/log/run.lock: another run makes this study: process")
    (finished.root / "hold").unlink()
    first.communicate()
    assert first.returncode == 0


def test_all_outputs_are_deleted_by_the_same_command_as_ever(copied):
    copied.snakemake("--delete-all-output", "reproduce")
    assert not list((copied.root / "results/toy").rglob("*.npz"))


def test_an_output_of_other_inputs_is_made_again(copied):
    """An interrupted run has made one output again; the copy has lost the order of times."""
    copied.make(f"{POINT}/path.npz", hydra="exaggerate.curvature_floor=0.2")
    shutil.rmtree(copied.root / ".snakemake")
    for file in (copied.root / "results").rglob("*"):
        file.touch()
    planned = copied.planned(*TARGETS, hydra="exaggerate.curvature_floor=0.2")
    assert planned["train"] == planned["gtstar"] * 2 == 4
