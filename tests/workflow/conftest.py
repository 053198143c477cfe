"""A copy of the project in which stubs take the place of the stages, so that a whole study is made in seconds."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from project import Project, copy_project

from carigs.settings import STAGES

STUDY = """# @package _global_
study:
  name: toy
  subjects: [toy, twin]
  variants: [alternating, surfhead]
  levels: [0.0, 0.25]
"""


@pytest.fixture(scope="session")
def stubbed(tmp_path_factory: pytest.TempPathFactory) -> Project:
    """Two subjects and two variants, stages replaced by stubs; nothing made yet.  Not to be changed."""
    project = copy_project(tmp_path_factory.mktemp("stubbed"))
    for stage in STAGES:
        shutil.copy2(Path(__file__).with_name("stub.py"), project.root / f"carigs/stages/{stage}.py")
    (project.root / "conf/study/toy.yaml").write_text(STUDY)
    shutil.copy2(project.root / "conf/subject/toy.yaml", project.root / "conf/subject/twin.yaml")
    return project


@pytest.fixture(scope="session")
def made(stubbed: Project, tmp_path_factory: pytest.TempPathFactory) -> Project:
    """The same with its table and figures.  Not to be changed."""
    project = Project(tmp_path_factory.mktemp("made") / "project")
    shutil.copytree(stubbed.root, project.root, symlinks=True)
    project.make("reproduce", "table")
    return project


@pytest.fixture
def finished(made: Project, tmp_path: Path) -> Project:
    """A finished study to edit."""
    shutil.copytree(made.root, tmp_path / "project", symlinks=True)
    return Project(tmp_path / "project")
