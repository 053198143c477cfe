"""A miniature of the toy study with the real stages."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from project import Project, copy_project

MINIATURE = " ".join(
    (
        "study.name=mini study.variants=[alternating,surfhead] study.levels=[0,0.25]",
        "capture.toy.width=64 capture.toy.height=84 capture.toy.cameras=3 capture.toy.steps_per_sequence=1",
        "capture.toy.supersampling=1 capture.toy.texture_size=128 capture.toy.hair_strands=300",
        "train.iterations=12 render.orbit_frames=2 tabulate.resamples=50 figures.blend_error_samples=3",
    )
)
pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def project(tmp_path_factory) -> Project:
    return copy_project(tmp_path_factory.mktemp("toy"))


@pytest.fixture(scope="module")
def results(project) -> Path:
    project.make("reproduce", "table", hydra=MINIATURE)
    return project.root / "results/mini"


def test_a_study_ends_in_a_table_and_figures(results):
    table = (results / "table/gamma=0.25.csv").read_text()
    for word in ("alternating", "surfhead", "psnr"):
        assert word in table.lower()
    figures = {file.name for file in (results / "figures/toy/gamma=0.25").iterdir()}
    assert {"gamma_strip_alternating.png", "gamma_strip_surfhead.png", "ablation.png", "blend_error.png"} <= figures


def test_nothing_half_written_is_left(results):
    assert not list(results.rglob("*.part*"))
    assert not list(results.rglob("*.checkpoint"))


def test_nothing_is_left_to_do(project, results):
    assert project.planned("reproduce", "table", hydra=MINIATURE) == {}


def test_the_same_settings_give_the_same_bytes_at_any_number_of_threads(project, results):
    first = results.with_name("first")
    results.rename(first)
    shutil.rmtree(project.root / ".snakemake")
    project.make("reproduce", "table", hydra=f"{MINIATURE} train.threads=2 render.threads=2")
    for pattern in ("table/*", "figures/**/*.*", "**/path.npz", "**/avatar.npz", "**/metrics.csv", "**/*.png"):
        files = [file.relative_to(first) for file in first.glob(pattern) if file.is_file()]
        assert files
        for file in files:
            assert (results / file).read_bytes() == (first / file).read_bytes(), f"{file} differs"


def test_bad_input_ends_in_one_line_before_work_starts(project):
    target = "results/bad/toy/capture.json"
    hydra = "study.name=bad capture.source=folder capture.folder=nowhere capture.head_model=model.npz"
    done = project.snakemake("--cores", "1", target, hydra=hydra)
    assert done.returncode == 1
    assert "Traceback" not in done.stdout + done.stderr
    (line,) = {line for line in (done.stdout + done.stderr).splitlines() if line.startswith("carigs: ")}
    for word in (target, "nowhere"):
        assert word in line
