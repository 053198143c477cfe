"""What a job is planned with."""

from __future__ import annotations

from pathlib import Path

import pytest
from omegaconf import OmegaConf

from carigs.config import compose, load_settings, settings_text
from carigs.runs.plan import job_plan, settings_digest
from carigs.settings import STAGES

TOY = ("study=toy", "subject=toy")


@pytest.mark.parametrize("stage", STAGES)
def test_the_digest_of_a_section_is_that_of_its_file(stage, tmp_path):
    (tmp_path / "all.yaml").write_text(settings_text(stage))
    section = load_settings(stage, tmp_path / "all.yaml")
    assert (
        settings_digest(stage, section) == settings_digest(stage, compose()[stage]) == job_plan(stage, [])["settings"]
    )


def test_a_text_with_an_escaped_interpolation_has_one_digest(tmp_path):
    override = r"metrics.edit_prompt=\${oc.env:SECRET}"
    (tmp_path / "all.yaml").write_text(settings_text("metrics", override))
    section = load_settings("metrics", tmp_path / "all.yaml")
    assert settings_digest("metrics", section) == job_plan("metrics", [override])["settings"]


@pytest.mark.parametrize(
    ("stage", "override", "counts"),
    [
        ("train", "gamma=0.2", False),  # its gamma is in its path
        ("hair", "train.iterations=7", False),
        ("hair", "regions.hair=[nose]", True),
        ("train", "train.iterations=7", True),
        ("train", "train.density.every=7", True),
        ("capture", "capture.toy.cameras=5", True),
        ("exaggerate", "exaggerate.regions={nose:0.1}", True),
    ],
)
def test_the_settings_of_a_stage_count(stage, override, counts):
    assert (job_plan(stage, [*TOY, override]) != job_plan(stage, TOY)) == counts


@pytest.fixture
def person(tmp_path) -> list[str]:
    (tmp_path / "anna").mkdir()
    for name in ("anna/transforms_train.json", "model.npz"):
        (tmp_path / name).write_text("{}")
    return ["study=own", "subject=own", f"capture.folder={tmp_path}/anna", f"capture.head_model={tmp_path}/model.npz"]


@pytest.mark.parametrize("stage", ["capture", "hair", "gtstar", "train", "render", "truth", "metrics", "figures"])
def test_every_stage_of_a_subject_depends_on_the_files_of_its_capture(person, stage, tmp_path, monkeypatch):
    outside = job_plan(stage, person)["outside"]
    assert {Path(path).name for path in outside} >= {"anna", "model.npz"} and all(outside.values())


def test_a_folder_named_by_level_counts_for_the_jobs_of_that_level(person, tmp_path):
    """True caricatures of a level lie in a folder of their own."""
    person = [*person, f"truth.folder='{tmp_path}/level={{level}}'"]
    outside = {level: job_plan("truth", person, level)["outside"] for level in (0.1, 0.25)}
    assert all(f"{tmp_path}/level={level}" in paths for level, paths in outside.items())


def test_the_code_of_the_toy_counts_for_the_toy_alone(person):
    from carigs.runs.sources import fingerprint

    with_toy, without = fingerprint("carigs.stages.capture"), fingerprint("carigs.stages.capture", ("carigs.toy",))
    assert job_plan("capture", TOY)["code"] == with_toy != without == job_plan("capture", person)["code"]


def test_plans_can_be_written_as_json(person):
    plan = job_plan("train", person)
    assert OmegaConf.to_container(OmegaConf.create(plan)) == plan
