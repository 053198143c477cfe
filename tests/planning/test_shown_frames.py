"""Frames that settings name are looked for before a study starts."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from miniature import write_ball

from carigs.capture import Capture, read_dataset
from carigs.capture.thinning import thin_frames
from carigs.cli import plan, run
from carigs.config import compose
from carigs.errors import InputError, SettingsError
from carigs.planning.shown_frames import check_shown_frames, listed_frames
from carigs.settings import CaptureSettings, Toy
from carigs.stages.capture import capture as capture_stage


@pytest.fixture(scope="module")
def ball(tmp_path_factory):
    folder = write_ball(tmp_path_factory.mktemp("data") / "ball")
    return [f"capture.folder={folder}", f"capture.head_model={folder}/head_model.npz", "capture.source=folder"]


@pytest.mark.parametrize(
    ("overrides", "named"),
    [
        (["figures.camera=3"], "figures.camera=3: the capture has no such test frame; there are cameras 0 to 2"),
        (["figures.timestep=2"], "figures.timestep=2: the capture has no such test frame"),
        (["figures.camera=1", "figures.timestep=4"], "figures.camera=1, figures.timestep=4: the capture"),
        (["figures.timestep=3", "capture.split=EMO-1"], "figures.timestep=3: the capture has no such test frame"),
        (["figures.timestep=1", "capture.split=EMO-1", "render.test_timesteps=2"], "figures.timestep=1: the capture"),
    ],
)  # fmt: skip
def test_a_frame_that_the_capture_lacks_is_refused(ball, overrides, named):
    if "capture.split=EMO-1" in overrides:  # then the sequence EXP-2 trains
        assert {frame.sequence for frame in listed_frames(compose(*ball, *overrides).capture)} == {"EMO-1", "EXP-2"}
    with pytest.raises(SettingsError, match=re.escape(named)):
        check_shown_frames(compose(*ball, *overrides))


@pytest.mark.parametrize(
    ("override", "says"),
    [
        ("capture.validation_camera=9", r"capture\.validation_camera: there is no camera 9; cameras: 0, 1, 2"),
        ("capture.split=EXP-7", r"capture\.split: there is no sequence EXP-7; sequences: EMO-1, EXP-2"),
    ],
)
def test_what_cannot_be_held_out_is_refused_before_a_run_starts(ball, override, says):
    for command in (run.main, plan.main):
        with pytest.raises(InputError, match=says):
            command([*ball, "study.subjects=[own]", override, *(["--dry-run"] if command is run.main else [])])


def test_frames_of_the_capture_are_accepted_and_an_unreadable_capture_is_not_checked(ball, tmp_path):
    for overrides in (
        [],
        ["figures.camera=2", "figures.timestep=3"],
        ["capture.split=EMO-1", "figures.timestep=2"],
    ):
        check_shown_frames(compose(*ball, *overrides))
    (tmp_path / "transforms_train.json").write_text("{")
    for folder in (tmp_path, tmp_path / "nowhere"):
        check_shown_frames(compose(*ball, f"capture.folder={folder}", "figures.camera=99"))


@pytest.mark.parametrize(
    "more",
    [[], ["capture.split=EMO-1"], ["capture.validation_camera=0"], ["capture.stride=2"], ["capture.max_frames=3"]],
)  # fmt: skip
def test_the_frames_are_those_of_the_dataset(ball, more):
    settings = compose(*ball, *more).capture
    folder, model = Path(settings.folder), Path(settings.head_model)
    read = read_dataset(folder, model, split=settings.split, validation_camera=settings.validation_camera)
    frames = thin_frames(read.frames, settings.stride, settings.max_frames)
    assert [key(frame) for frame in listed_frames(settings)] == [key(frame) for frame in frames]


def key(frame):
    return frame.timestep, frame.camera, frame.sequence, frame.split


@pytest.mark.slow
def test_the_frames_of_the_toy_are_those_that_it_writes(tmp_path):
    small = {"width": 16, "height": 16, "cameras": 3, "steps_per_sequence": 2, "texture_size": 128, "supersampling": 1}
    toy = Toy(**small, hair_strands=50)
    capture_stage(CaptureSettings(toy=toy), index=tmp_path / "capture.json", dataset=tmp_path / "dataset")
    frames = Capture.load(tmp_path / "capture.json").frames
    settings = compose(*(f"capture.toy.{key}={value}" for key, value in small.items()), "capture.toy.hair_strands=50")
    assert {*map(key, listed_frames(settings.capture))} == {*map(key, frames)}


def test_the_command_refuses_it_before_it_starts(ball):
    with pytest.raises(SettingsError, match=r"figures\.camera=9: the capture has no such test frame"):
        run.main([*ball, "study.subjects=[own]", "figures.camera=9", "--dry-run"])
