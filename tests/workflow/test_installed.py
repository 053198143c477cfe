"""The command of the installed package: the workflow in `carigs/_project`, another directory than the repository."""

from __future__ import annotations

import pytest
import trimesh


def test_own_studies_and_subjects_are_found_and_mistakes_are_one_line(carigs):
    settings = carigs("settings", "study=small")
    assert settings.returncode == 0 and "- anna" in settings.stdout
    mistake = carigs("run", "study=smal")
    assert (mistake.returncode, mistake.stdout) == (1, "")
    assert (
        mistake.stderr == "carigs: study=smal is unknown; "
        "known: ablation, ava256, ict, levels, nersemble, own, paper, paper_editing, paper_size, small, toy, video\n"
    )
    assert carigs("run", "--coers", "2").returncode == 2
    assert carigs("walk").returncode == 2


@pytest.mark.slow
def test_a_dry_run_makes_nothing(carigs):
    done = carigs("run", "study=small", "capture.toy.supersampling=1", "-n")
    assert done.returncode == 0, done.stdout + done.stderr
    assert not (carigs.folder / "results").exists()


@pytest.mark.slow
def test_a_failing_run_is_an_error(carigs):
    capture = "capture.source=folder capture.folder=nowhere capture.head_model=model.npz"
    assert carigs("run", "study=small", "study.name=bad", *capture.split()).returncode == 1


@pytest.mark.slow
def test_a_mesh_is_exaggerated(carigs):
    trimesh.creation.icosphere(subdivisions=3, radius=80.0).export(carigs.folder / "head.obj")
    try:
        done = carigs("mesh", "head.obj", "-o", "out.ply")
        assert done.returncode == 0, done.stderr
        assert (carigs.folder / "out.ply").is_file() and (carigs.folder / "out_preview.png").is_file()
    finally:
        for file in carigs.folder.glob("*.*"):
            file.unlink() if file.is_file() else None
