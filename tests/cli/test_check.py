"""`carigs check`: everything that is wrong in one pass, and the exit code."""

import json
import shutil
from pathlib import Path

import pytest
from miniature import write_ball

from carigs.capture.images import read_rgb
from carigs.cli.main import main


@pytest.fixture
def ball(tmp_path) -> Path:
    return write_ball(tmp_path / "ball")


def check(folder: Path, *options: str) -> int:
    return main(["check", str(folder), "--head-model", str(folder / "head_model.npz"), *options])


def edit(folder: Path, change) -> None:
    file = folder / "transforms_train.json"
    content = json.loads(file.read_text())
    change(content["frames"])
    file.write_text(json.dumps(content))


def test_a_sound_dataset_has_no_errors(ball, capsys):
    assert check(ball, "--split", "EXP-2") == 0
    printed = capsys.readouterr().out
    assert "errors: none\nwarnings: none\n3 cameras see the head from 2" in printed
    assert "12 frames, 4 timesteps, 3 cameras" in printed
    all_cameras = next(line for line in printed.splitlines() if line.startswith("     all"))
    assert float(all_cameras.split()[1]) > 0.95  # the mattes are the mesh


def test_files_that_take_one_of_three_cameras_away_are_named(ball, capsys):
    assert check(ball) == 0
    printed = capsys.readouterr().out
    assert "warnings: 1\n  the split takes one of 3 cameras away from the training" in printed
    assert "camera 1" in printed and "capture.split=blocks" in printed and "\n2 cameras see the head" in printed


def test_all_errors_are_found_in_one_pass(ball, capsys):
    (ball / "images/00000_00.png").unlink()
    damaged = ball / "fg_masks/00002_02.png"
    damaged.write_bytes(damaged.read_bytes()[:-30])
    shutil.copyfile(ball / "flame_param/00000.npz", ball / "flame_param/00001.npz")

    def change(frames):
        frames[2]["transform_matrix"] = [[1, 0], [0, 1]]
        del frames[3]["camera_index"]

    edit(ball, change)
    assert check(ball) == 1
    printed = capsys.readouterr().out
    assert "errors: 4" in printed
    for part in (
        "images/00000_00.png",
        "fg_masks/00002_02.png",
        "frames[2].transform_matrix",
        "frames[3].camera_index",
    ):
        assert part in printed
    assert printed.count("remedy: ") >= 4


def test_warnings_alone_are_no_failure(ball, capsys):
    shutil.copyfile(ball / "images/00002_00.png", ball / "images/00002_02.png")
    assert check(ball) == 0
    assert "holds the same pixels as images/00002_00.png" in capsys.readouterr().out


def test_many_faults_of_a_kind_are_listed_in_a_few_lines(ball, capsys):
    edit(ball, lambda frames: [frame.pop("camera_index") for frame in frames])
    assert check(ball) == 1
    printed = capsys.readouterr().out
    assert "camera_index" in printed and "more" in printed
    assert len(printed.splitlines()) < 30


def test_a_missing_folder_is_one_line(tmp_path, capsys):
    assert check(tmp_path / "nowhere") == 1
    line = f"carigs: {tmp_path / 'nowhere'}: no such dataset folder; remedy: name the folder of transforms_train.json\n"
    assert capsys.readouterr().err == line


def test_the_sheet_shows_frames_and_mesh(ball, tmp_path):
    assert check(ball, "--sheet", str(tmp_path / "sheet.png")) == 0
    image = read_rgb(tmp_path / "sheet.png")
    is_green = (image[..., 1] > 0.6) & (image[..., 0] < 0.4) & (image[..., 2] < 0.5)
    assert is_green.mean() > 0.001  # the outline of the mesh
