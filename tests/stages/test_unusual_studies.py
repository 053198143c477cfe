"""Studies that are unusual and valid end with a report: what cannot be drawn is left out, and named."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import Phase, assume, given, settings
from hypothesis import strategies as st
from miniature import ball_cameras, ball_model, write_ball
from stages.small_study import METHOD, SmallStudy, small_settings

from carigs.capture import Camera, Capture, read_dataset
from carigs.errors import CarigsWarning
from carigs.settings import CaptureSettings, Figures, Render, Toy, Truth
from carigs.stages.capture import capture as capture_stage

pytestmark = pytest.mark.filterwarnings("ignore:no value of:carigs.errors.CarigsWarning")
FIGURES = {"ablation", "renderings", "alternation", "hair", "mouth", "hair_mask", "local_edits", "blend_error"} | {
    "misregistration"
}
VARIANTS = (METHOD, "surfhead", "gtstar_only", "no_mask")


def index_of(folder: Path, change: Callable[[Capture], Capture] = lambda capture: capture, **ball) -> Path:
    """The index of a ball's capture."""
    place = write_ball(folder / "ball_capture", **ball)
    change(read_dataset(place, place / "head_model.npz")).save(folder / "capture.json")
    return folder / "capture.json"


def without(*frames: tuple[str, int]) -> Callable[[Capture], Capture]:
    """Leaves out the frames of a split and camera; camera -1 stands for all."""

    def change(capture: Capture) -> Capture:
        gone = {*frames}
        kept = (f for f in capture.frames if not {(f.split, f.camera), (f.split, -1)} & gone)
        return replace(capture, frames=tuple(kept))

    return change


def check_finished(study: SmallStudy) -> None:
    """Every figure is drawn, or named in the list of what was left out; the report has both."""
    wanted = FIGURES | {f"gamma_strip_{variant}" for variant in study.variants}
    assert study.drawn | study.left_out.keys() == wanted and not study.drawn & study.left_out.keys()
    for name, reason in study.left_out.items():
        assert reason and name in study.report
    assert study.report.count("<img") >= len(study.drawn)


SIZES = {
    "1x1": (1, 1), "2x3": (2, 3), "8x8": (8, 8), "wide": (96, 12), "high": (6, 90),
}  # fmt: skip


def cameras_of_size(width: int, height: int) -> dict[int, Camera]:
    return {
        i: replace(
            c, fx=c.fx * width / 40, fy=c.fy * width / 40, cx=width / 2, cy=height / 2, width=width, height=height
        )
        for i, c in ball_cameras().items()
    }


@pytest.mark.slow
@pytest.mark.parametrize("size", SIZES)
def test_images_of_any_size(size, tmp_path):
    check_finished(SmallStudy(tmp_path, index_of(tmp_path, cameras=cameras_of_size(*SIZES[size]))).make())


@pytest.mark.slow
def test_the_validation_camera_without_a_test_frame_gives_way_to_the_next(tmp_path):
    study = SmallStudy(tmp_path, index_of(tmp_path, without(("test", 1))), variants=VARIANTS).make()
    check_finished(study)
    assert {"ablation", "renderings", "hair", "local_edits", "alternation"} <= study.drawn


@pytest.mark.slow
def test_a_capture_without_test_frames_has_the_figures_that_need_none(tmp_path):
    with pytest.warns(CarigsWarning, match="the capture has no test frame"):
        study = SmallStudy(tmp_path, index_of(tmp_path, without(("test", -1), ("val", -1)))).make()
    check_finished(study)
    assert {"local_edits", "blend_error"} <= study.drawn
    assert study.left_out["ablation"] == "the capture has no test frame"


@pytest.mark.slow
def test_a_study_without_the_method_has_a_report(tmp_path):
    study = SmallStudy(tmp_path, index_of(tmp_path), variants=("surfhead",)).make()
    check_finished(study)
    assert "lacks the variant alternating" in study.left_out["local_edits"]


@pytest.mark.slow
def test_a_study_that_measures_nothing_has_a_report(tmp_path):
    settings = small_settings() | {"render": Render(orbit_frames=1)}
    with pytest.warns(CarigsWarning, match="the capture has no test frame"):
        index = index_of(tmp_path, without(("test", -1), ("val", -1), ("train", 2)))
        study = SmallStudy(tmp_path, index, settings=settings, levels=(0.0,)).make()
    check_finished(study)
    assert "no test frame was rendered" in (tmp_path / "card.json").read_text()


MODELS = {
    "no regions": {},
    "a vertex": {"scalp": np.array([5]), "nose": np.array([7]), "ears": np.array([], int)},
    "the whole head": {"scalp": np.arange(642), "nose": np.arange(642), "lips": np.arange(642)},
}


@pytest.mark.slow
@pytest.mark.parametrize("regions", MODELS)
def test_head_models_with_any_regions(regions, tmp_path):
    index = index_of(tmp_path, model=replace(ball_model(), regions=MODELS[regions]))
    check_finished(SmallStudy(tmp_path, index, variants=(METHOD, "no_mask")).make())


@pytest.mark.slow
@pytest.mark.parametrize("images", [0, 1])
def test_true_caricatures_of_some_frames(images, tmp_path):
    index = index_of(tmp_path)
    capture, place, entries = Capture.load(index), tmp_path / "truth", []
    for folder in ("images", "fg_masks"):
        (place / folder).mkdir(parents=True)
    for frame in capture.split("test")[:images]:
        names = f"images/{frame.name}.png", f"fg_masks/{frame.name}.png"
        for source, name in zip((frame.image, frame.mask), names, strict=True):
            shutil.copy(capture.root / source, place / name)
        keys = {"timestep_index": frame.timestep, "camera_index": frame.camera}
        entries.append({**keys, "file_path": names[0], "fg_mask_path": names[1]})
    (place / "frames.json").write_text(json.dumps(entries))
    study = SmallStudy(tmp_path, index, settings=small_settings() | {"truth": Truth(folder=str(place))}).make()
    check_finished(study)
    assert ("misregistration" in study.drawn) == bool(images)


@pytest.mark.slow
@pytest.mark.parametrize(("cameras", "width"), [(1, 32), (3, 16)])
def test_a_tiny_toy_with_all_that_a_head_has(cameras, width, tmp_path):
    toy = Toy(width=width, height=width, cameras=cameras, steps_per_sequence=1, texture_size=128, hair_strands=200)
    capture_stage(CaptureSettings(toy=toy), index=tmp_path / "capture.json", dataset=tmp_path / "dataset")
    check_finished(SmallStudy(tmp_path, tmp_path / "capture.json", variants=VARIANTS).make())


SPLITS = [("train", 2), ("val", -1), ("test", 0), ("test", 1), ("test", 2)]


@pytest.mark.slow
@settings(max_examples=8, deadline=None, phases=(Phase.explicit, Phase.reuse, Phase.generate))  # a study is slow
@given(
    gone=st.sets(st.sampled_from(SPLITS)),
    mattes=st.booleans(),
    variants=st.lists(st.sampled_from(VARIANTS), min_size=1, max_size=3, unique=True),
    seeds=st.sampled_from([(0,), (7, 0)]),
    levels=st.sampled_from([(0.0,), (0.0, 0.25), (0.0, 0.1, 0.25)]),
    subject=st.sampled_from(["ball", "bäll-_1"]),
    orbit=st.sampled_from([0, 1, 2]),
    timesteps=st.sampled_from([None, 1]),
    frame=st.sampled_from([(None, None), (0, None), (None, 3), (99, 99)]),
)
@pytest.mark.filterwarnings("ignore:figures of test frames are left out")
def test_every_combination_ends_with_a_report(
    tmp_path_factory, gone, mattes, variants, seeds, levels, subject, orbit, timesteps, frame
):
    held_out = {("test", 0), ("test", 1), ("test", 2), ("val", -1)}
    assume(orbit or not held_out <= gone)  # else nothing is rendered: no dataset is read without test frames
    folder = tmp_path_factory.mktemp("study")

    def change(capture: Capture) -> Capture:
        kept = without(*gone)(capture)
        return kept if mattes else replace(kept, frames=tuple(replace(f, mask=None) for f in kept.frames))

    camera, timestep = frame
    made_with = small_settings() | {
        "render": Render(orbit_frames=orbit, test_timesteps=timesteps),
        "figures": Figures(camera=camera, timestep=timestep),
    }
    study = SmallStudy(
        folder, index_of(folder, change), subject=subject, variants=variants, seeds=seeds, levels=levels,
        settings=made_with,
    ).make()  # fmt: skip
    check_finished(study)
    has_frame = camera != 99 and any(("test", c) not in gone for c in ([camera] if camera is not None else (0, 1, 2)))
    assert ("ablation" in study.drawn) == has_frame
    assert re.search(r"<script", study.report)
