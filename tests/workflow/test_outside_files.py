"""A change of a file that the settings name re-runs what is made from it, with Snakemake's notes and without."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from project import Project

SETTINGS = """# @package _global_
study: {name: toy, subjects: [toy], variants: [alternating], levels: [0.0, 0.25]}
capture: {source: folder, folder: anna, head_model: flame.pkl}
exaggerate: {file: "sculpt/{gamma}.obj"}
gtstar: {provider: precomputed, folder: edited}
train: {start: start.npz}
truth: {folder: "truth/{level}"}
metrics: {weights: weights}
"""
SUMMARIES = {"tabulate", "card", "report"}
EVALUATION = {"metrics", "figures", *SUMMARIES}
TRAINING = {"train", "html", "render", *EVALUATION}
AFTER_PATH = {"target_sheet", "gtstar", *TRAINING}
AFTER_CAPTURE = {"exaggerate", "truth", *AFTER_PATH}
EXPECTED = {
    "anna/transforms_train.json": {"capture", "hair", *AFTER_CAPTURE},
    "flame.pkl": {"capture", "hair", *AFTER_CAPTURE},
    "sculpt/0.25.obj": AFTER_CAPTURE,
    "sculpt/0.5.obj": set(),  # of another gamma
    "edited/00000_00.png": {*AFTER_PATH},
    "start.npz": TRAINING,
    "truth/0.25/frames.json": {"truth", *EVALUATION},
    "weights/ViT-B-32.pt": {"metrics", *SUMMARIES},
}


@pytest.fixture(scope="module")
def study(stubbed: Project, tmp_path_factory: pytest.TempPathFactory) -> Project:
    """A finished study whose settings name files of every kind.  Not to be changed."""
    project = copy(stubbed, tmp_path_factory.mktemp("outside"))
    (project.root / "conf/study/toy.yaml").write_text(SETTINGS)
    (project.root / "conf/subject/toy.yaml").write_text("# @package _global_\n")  # it sets the source
    for name in EXPECTED:
        (project.root / name).parent.mkdir(parents=True, exist_ok=True)
        (project.root / name).touch()
    project.make("reproduce", "table")
    return project


def copy(project: Project, folder: Path) -> Project:
    shutil.copytree(project.root, folder / "project", symlinks=True)
    return Project(folder / "project")


@pytest.mark.slow
@pytest.mark.parametrize("notes", [True, False], ids=["with notes", "without notes"])
def test_each_file_reruns_what_is_made_from_it(study, notes, tmp_path):
    project = copy(study, tmp_path)
    if not notes:
        shutil.rmtree(project.root / ".snakemake")
    assert project.planned("reproduce", "table") == {}
    for name, expected in EXPECTED.items():
        before = (project.root / name).stat()
        (project.root / name).write_text("changed")
        assert set(project.planned("reproduce", "table")) == expected, name
        (project.root / name).write_text("")
        os.utime(project.root / name, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert project.planned("reproduce", "table") == {}


@pytest.mark.slow
def test_results_are_up_to_date_where_their_dataset_is_not(study, tmp_path):
    project = copy(study, tmp_path)
    for name in {".snakemake", *(name.split("/")[0] for name in EXPECTED)}:
        path = project.root / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()
    assert project.planned("reproduce", "table") == {}
