"""The package as it is installed: the workflow in `carigs/_project`, nothing of the repository, another directory."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
import trimesh
from project import ROOT

STUDY = """# @package _global_
study: {name: tiny, subjects: [anna], variants: [alternating], levels: [0, 0.25]}
train: {iterations: 12}
render: {orbit_frames: 2}
tabulate: {resamples: 50}
figures: {blend_error_samples: 3}
"""
SUBJECT = """# @package _global_
capture:
  toy: {seed: 7, width: 64, height: 84, cameras: 3, steps_per_sequence: 1}
"""
OVERRIDES = "capture.toy.supersampling=1 capture.toy.texture_size=128 capture.toy.hair_strands=300"


class Installed:
    """A working directory, and the command `carigs` of an installed package."""

    def __init__(self, packages: Path, folder: Path):
        self.packages, self.folder = packages, folder

    def __call__(self, *arguments: str) -> subprocess.CompletedProcess:
        """Run `carigs` in the folder."""
        return subprocess.run(
            [sys.executable, "-m", "carigs", *arguments],
            cwd=self.folder,
            env={**os.environ, "PYTHONPATH": str(self.packages)},
            capture_output=True,
            text=True,
        )


@pytest.fixture(scope="module")
def carigs(tmp_path_factory) -> Installed:
    """The files of the wheel, as pyproject.toml lists them, in a folder of packages."""
    packages, folder = tmp_path_factory.mktemp("packages"), tmp_path_factory.mktemp("work")
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    moved = {**{name: name for name in wheel["packages"]}, **wheel["force-include"]}
    for source, target in moved.items():
        if (ROOT / source).is_dir():
            shutil.copytree(ROOT / source, packages / target, ignore=shutil.ignore_patterns("*.pyc"))
        else:
            shutil.copy2(ROOT / source, packages / target)
    for name, text in {"study/tiny": STUDY, "subject/anna": SUBJECT}.items():
        file = folder / f"conf/{name}.yaml"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return Installed(packages, folder)


def test_own_studies_and_subjects_are_found_and_mistakes_are_one_line(carigs):
    settings = carigs("settings", "study=tiny")
    assert settings.returncode == 0 and "- anna" in settings.stdout
    mistake = carigs("run", "study=tyni")
    assert (mistake.returncode, mistake.stdout) == (1, "")
    assert mistake.stderr == "carigs: study=tyni is unknown; known: ablation, ict, levels, paper, tiny, toy\n"
    assert carigs("run", "--coers", "2").returncode == 2
    assert carigs("walk").returncode == 2


@pytest.mark.slow
def test_a_dry_run_makes_nothing(carigs):
    done = carigs("run", "study=tiny", *OVERRIDES.split(), "-n")
    assert done.returncode == 0, done.stdout + done.stderr
    assert not (carigs.folder / "results").exists()


@pytest.mark.slow
def test_a_study_is_made_in_the_current_directory(carigs):
    done = carigs("run", "study=tiny", *OVERRIDES.split(), "--cores", "2")
    assert done.returncode == 0, done.stdout + done.stderr
    assert (carigs.folder / "results/tiny/table/gamma=0.25.md").is_file()
    assert (carigs.folder / "results/tiny/figures/anna/gamma=0.25/ablation.png").is_file()
    assert {file.name for file in carigs.folder.iterdir()} == {"conf", "results", ".snakemake"}


@pytest.mark.slow
def test_a_failing_run_is_an_error(carigs):
    capture = "capture.source=folder capture.folder=nowhere capture.head_model=model.npz"
    assert carigs("run", "study=tiny", "study.name=bad", *capture.split()).returncode == 1


@pytest.mark.slow
def test_a_mesh_is_exaggerated(carigs):
    trimesh.creation.icosphere(subdivisions=3, radius=80.0).export(carigs.folder / "head.obj")
    try:
        done = carigs("mesh", "head.obj", "-o", "out.ply")
        assert done.returncode == 0, done.stderr
        assert (carigs.folder / "out.ply").is_file() and (carigs.folder / "out.png").is_file()
    finally:
        for file in carigs.folder.glob("*.*"):
            file.unlink() if file.is_file() else None
