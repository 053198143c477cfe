"""`carigs augment`: what is drawn, what is rendered, and which mistakes are told."""

import csv

import numpy as np
import pytest
from avatars import ball_avatar

from carigs.capture.images import read_rgb8
from carigs.cli.main import main
from carigs.library import load, orbit
from carigs.library.labelled_set import COLUMNS, draw_labels
from carigs.splat.avatar import save_avatar

PEOPLE = {"anna": [0, 1, 2], "berta": [5]}


def test_a_pose_is_the_same_at_every_level_and_another_for_every_person_and_number():
    labels = draw_labels(PEOPLE, (0.0, 0.1, 0.25), 40, azimuth=30, elevation=10)
    assert len(labels) == len({label.file for label in labels}) == 2 * 3 * 40
    views = {}
    for label in labels:
        views.setdefault((label.person, label.pose), set()).add((label.azimuth, label.elevation, label.timestep))
        assert label.timestep in PEOPLE[label.person]
    assert all(len(found) == 1 for found in views.values())
    assert len(set().union(*views.values())) == 80
    angles = np.array([(label.azimuth, label.elevation) for label in labels])
    assert (np.abs(angles) <= [30, 10]).all() and (np.ptp(angles, axis=0) > [50, 15]).all()


def test_poses_depend_on_seed_and_name_alone():
    both = draw_labels(PEOPLE, (0.0,), 5)
    assert draw_labels({"berta": [5]}, (0.0,), 5) == both[5:]
    assert draw_labels(PEOPLE, (0.0,), 5) == both
    assert [label[4:] for label in draw_labels(PEOPLE, (0.0,), 5, seed=1)] != [label[4:] for label in both]
    assert draw_labels(PEOPLE, (0.0,), 3) == [*both[:3], *both[5:8]]  # more poses change no earlier one


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    path = tmp_path_factory.mktemp("avatar") / "avatar.npz"
    save_avatar(path, ball_avatar())
    return path


def test_the_command_writes_what_its_labels_say(file, tmp_path, capsys):
    folder = tmp_path / "faces"
    options = ["--level", "0", "--level", "0.2", "--poses", "2", "--size", "32"]
    assert main(["augment", str(folder), f"anna={file}", f"berta={file}", *options]) == 0
    assert "faces: 8 images of 2 people at levels 0, 0.2" in capsys.readouterr().out
    with (folder / "labels.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert tuple(rows[0]) == COLUMNS and len(rows) == 8
    assert {row["file"] for row in rows} == {p.relative_to(folder).as_posix() for p in folder.rglob("*.png")}
    avatar = load(file)
    for row in rows:
        azimuth, elevation, level = (float(row[name]) for name in ("azimuth", "elevation", "level"))
        (camera,) = orbit(avatar, 1, azimuth=azimuth, elevation=elevation, size=32)
        expression = avatar.avatar.sequence.parameters[int(row["timestep"])].expression
        expected = np.rint(255 * avatar.render(camera, level=level, expression=expression))
        np.testing.assert_allclose(read_rgb8(folder / row["file"]), expected, atol=1)


@pytest.mark.parametrize(
    ("arguments", "code", "problem"),
    [
        (["x={file}", "x={file}"], 1, "x: two avatars have this name"),
        (["x={file}", "--level", "0.9"], 1, "--level 0.9: the avatar of x was made for 0 to"),
        (["x={file}", "--poses", "0"], 1, "--poses 0: expected 1 to"),
        (["x={file}", "--azimuth", "nan"], 1, "--azimuth nan: expected 0 to 180"),
        (["x={file}", "--poses", "999999"], 1, "images; at most"),
        (["x=none.npz"], 1, "none.npz"),
    ],
)
def test_mistakes_are_one_line_and_leave_nothing(file, tmp_path, monkeypatch, capsys, arguments, code, problem):
    monkeypatch.chdir(tmp_path)
    assert main(["augment", "faces", *(text.format(file=file) for text in arguments)]) == code
    error = capsys.readouterr().err
    assert problem in error and error.count("\n") == 1
    assert not [*tmp_path.iterdir()]


@pytest.mark.parametrize("name", ["../x", "a b", ""])
def test_a_name_that_is_no_name_of_a_folder_is_a_wrong_command_line(file, tmp_path, capsys, name):
    with pytest.raises(SystemExit) as ended:
        main(["augment", str(tmp_path / "faces"), f"{name}={file}"])
    assert ended.value.code == 2 and "expected NAME=AVATAR.npz" in capsys.readouterr().err


def test_a_folder_with_files_is_left_alone(file, tmp_path, capsys):
    (tmp_path / "mine.txt").write_text("mine")
    assert main(["augment", str(tmp_path), f"x={file}", "--poses", "1", "--size", "16"]) == 1
    assert "is not an empty folder" in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]
