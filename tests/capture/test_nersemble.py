"""A union of sequences as NeRSemble has it, from the files to the table."""

import json
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from nersemble import CAMERAS, MISSING, SEQUENCES, SIZE, STEPS, UNION, write_nersemble
from project import Project, copy_project, shared_kernels

from carigs.capture import Capture, read_dataset
from carigs.head.teeth import FLAME_WITH_TEETH_COUNTS
from carigs.plausibility import check_capture, resolve_cy


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("nersemble")
    write_nersemble(folder)
    return folder


@pytest.fixture(scope="module")
def union(data) -> Capture:
    return read_dataset(data / UNION, data / "flame2023.pkl")


@pytest.mark.slow
def test_sequences_keep_their_own_cameras(union):
    assert len(union.calibrations) == len(CAMERAS) * len(SEQUENCES)
    assert len(union.frames) == len(CAMERAS) * len(SEQUENCES) * STEPS - 1
    assert MISSING not in union.frame_at
    for c in CAMERAS:
        centres = {frame.sequence: union.camera(frame).centre for frame in union.frames if frame.camera == c}
        assert set(centres) == set(SEQUENCES)
        moved = centres["EXP-3"] - centres["EMO-1"]
        np.testing.assert_allclose(moved, -2 * np.array([0.002, -0.001, 0]), atol=1e-9)


def test_heads_have_teeth_with_either_offset(union):
    assert len(union.model.v_template) == FLAME_WITH_TEETH_COUNTS[0]
    first, second = (union.parameters(t).static_offset for t in (0, STEPS))  # with teeth, and without
    np.testing.assert_array_equal(first, second)


def test_the_index_keeps_all(union, tmp_path):
    union.save(tmp_path / "capture.json")
    again = Capture.load(tmp_path / "capture.json")
    assert again.frames == union.frames
    for a, b in zip(again.calibrations, union.calibrations, strict=True):
        np.testing.assert_array_equal(a.camera_from_world, b.camera_from_world)
        assert a.intrinsics == b.intrinsics


def test_flipped_cy_is_found_and_nothing_else_is_wrong(union):
    found = resolve_cy(union)
    assert found.cy.startswith("flipped: ")
    for before, after in zip(union.calibrations, found.calibrations, strict=True):
        assert after.cy == pytest.approx(SIZE[1] - before.cy)
    assert check_capture(found).warnings == ()
    kept = resolve_cy(found)
    assert kept.cy.startswith("opencv: ") and kept.calibrations == found.calibrations


@pytest.mark.parametrize(("split", "held_out"), [("files", "EMO-4"), ("released", "EMO-4"), ("EXP-2", "EXP-2")])
def test_splits(data, split, held_out):
    found = read_dataset(data / UNION, data / "flame2023.pkl", split=split)
    assert {frame.sequence for frame in found.split("test")} == {held_out}
    by_files = {8} if split == "files" else set()  # few cameras all train, unless the files say otherwise
    assert {frame.camera for frame in found.split("val")} == by_files
    assert {frame.camera for frame in found.split("train")} == set(CAMERAS) - by_files


@pytest.mark.slow
def test_from_capture_to_table(data, tmp_path, monkeypatch):
    """The study `nersemble` with one person, two variants and few iterations; then a camera is calibrated anew."""
    monkeypatch.setenv("NERSEMBLE", str(data))
    project: Project = copy_project(tmp_path)
    hydra = " ".join(
        [
            "study=nersemble", "study.subjects=[nersemble_074]", "study.variants=[alternating,surfhead]",
            "study.levels=[0,0.25]", "train.iterations=40", "train.sh_degree=0", "train.hair_layers=1",
            "render.orbit_frames=2", "metrics.embeddings=[]", "metrics.lpips=[]",
        ]
    )  # fmt: skip
    with shared_kernels():
        project.make("table", hydra=hydra)
    index = json.loads((project.root / "results/nersemble/nersemble_074/capture.json").read_text())
    assert index["split_rule"] == "EXP-2, validation camera 8" and index["cy"].startswith("flipped")
    table = pd.read_csv(project.root / "results/nersemble/table/gamma=0.25.csv")
    assert set(table["split"]) == {"EXP-2, validation camera 8"}
    psnr = table[(table.metric == "psnr") & (table.level == 0) & (table.region == "full") & table["minus"].isna()]
    assert set(psnr["variant"]) == {"alternating", "surfhead"} and (psnr["mean"] > 10).all()
    assert project.planned("table", hydra=hydra) == {}
    file = data / UNION / "transforms_train.json"
    os.utime(file, ns=(0, file.stat().st_mtime_ns + 1_000_000_000))
    planned = project.planned("table", hydra=hydra)
    assert planned["capture"] == 1 and planned["train"] == 2
