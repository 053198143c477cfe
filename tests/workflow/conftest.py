"""A copy of the project with stubs for stages, which makes a study in seconds, and the package as it is installed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from filelock import FileLock
from project import Installed, Project, copy_packages, copy_project, shared_kernels
from workflow.own_study import write_own_study

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
    base = tmp_path_factory.getbasetemp()
    first = Project((base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "first")
    with FileLock(f"{first.root}.lock"):  # one process of pytest-xdist makes it for all
        if not first.root.exists():
            shutil.copytree(stubbed.root, first.root, symlinks=True)
            first.make("reproduce", "table")
    project = Project(tmp_path_factory.mktemp("made") / "project")
    shutil.copytree(first.root, project.root, symlinks=True)
    return project


@pytest.fixture
def finished(made: Project, tmp_path: Path) -> Project:
    """A finished study to edit."""
    shutil.copytree(made.root, tmp_path / "project", symlinks=True)
    return Project(tmp_path / "project")


@pytest.fixture(scope="session")
def packages(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The installed package: the workflow in `carigs/_project`, and nothing else of the repository."""
    folder = tmp_path_factory.mktemp("packages")
    copy_packages(folder)
    with shared_kernels():
        yield folder


@pytest.fixture(scope="module")
def carigs(packages: Path, tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """The command of the installed package, in a folder with a study and a subject of the user."""
    folder = tmp_path_factory.mktemp("work")
    write_own_study(folder)
    return Installed(packages, folder)
