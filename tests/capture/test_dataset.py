"""Datasets on disk: round trips, and one-line errors for every broken input."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
from miniature import ball_cameras, write_ball

from carigs.capture import Capture, read_dataset
from carigs.capture.images import read_rgb, write_png
from carigs.errors import InputError
from carigs.runs.outside_files import files_digest


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    return write_ball(tmp_path_factory.mktemp("ball"))


@pytest.fixture
def dataset(written, tmp_path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "ball"))


def read(folder: Path) -> Capture:
    return read_dataset(folder, folder / "head_model.npz")


def test_reads_what_was_written(written):
    capture = read(written)
    assert {split: len(capture.split(split)) for split in ("train", "val", "test")} == {"train": 6, "val": 3, "test": 3}
    assert {frame.sequence for frame in capture.split("test")} == {"EXP-2"}
    assert capture.validation_camera == 1
    for c, camera in ball_cameras().items():
        np.testing.assert_allclose(capture.cameras[c].camera_from_world, camera.camera_from_world, atol=1e-12)
        assert (capture.cameras[c].fx, capture.cameras[c].cx) == (camera.fx, camera.cx)
    frame = capture.split("train")[0]
    assert capture.image(frame).shape == (48, 40, 3)
    np.testing.assert_array_equal(capture.image(frame)[capture.mask(frame) == 0], 1.0)


def test_index_round_trip_survives_a_move(dataset, tmp_path):
    """An index beside its dataset may be moved together with it."""
    capture = read(dataset)
    capture.save(tmp_path / "capture.json")
    shutil.copytree(tmp_path, tmp_path.parent / f"{tmp_path.name}-moved")
    moved = Capture.load(tmp_path.parent / f"{tmp_path.name}-moved" / "capture.json")
    assert moved.frames == capture.frames
    assert "-moved" in str(moved.root)
    np.testing.assert_array_equal(moved.image(moved.frames[0]), capture.image(capture.frames[0]))
    np.testing.assert_array_equal(moved.parameters(2).expression, capture.parameters(2).expression)


def test_val_may_be_missing_and_the_frontal_camera_takes_its_place(dataset):
    (dataset / "transforms_val.json").unlink()
    assert read(dataset).validation_camera == 1


@pytest.mark.parametrize("value", [0.0, 1 / 255, 0.5, 1.0])
def test_png_round_trip(tmp_path, value):
    image = np.full((3, 5, 3), value) * [1, 0.5, 0]
    write_png(tmp_path / "a.png", image)
    np.testing.assert_allclose(read_rgb(tmp_path / "a.png"), image, atol=0.5 / 255 + 1e-6)


def edit(folder: Path, split: str, change) -> None:
    file = folder / f"transforms_{split}.json"
    content = json.loads(file.read_text())
    change(content)
    file.write_text(json.dumps(content))


def cut(file: Path, count: int) -> None:
    file.write_bytes(file.read_bytes()[:-count])


BREAKAGES = {
    "missing folder": (shutil.rmtree, "ball: no such dataset folder"),
    "broken json": (lambda d: (d / "transforms_train.json").write_text('{"frames": [}'), "column 13: broken JSON"),
    "no frames key": (lambda d: (d / "transforms_train.json").write_text("{}"), "train.json: frames: this key is"),
    "empty test split": (lambda d: edit(d, "test", lambda c: c.update(frames=[])), "frames: the test split is empty"),
    "missing image": (lambda d: (d / "images/00001_00.png").unlink(), "00001_00.png: no such image"),
    "missing mask": (lambda d: (d / "fg_masks/00001_00.png").unlink(), "00001_00.png: no such image"),
    "cut image": (lambda d: cut(d / "images/00001_00.png", 30), "00001_00.png: .*the end of the PNG is missing"),
    "corrupt image": (lambda d: (d / "images/00001_00.png").write_bytes(b"junk" * 9), "not a PNG"),
    "another size": (lambda d: write_png(d / "images/00001_00.png", np.ones((8, 9, 3))), "9 x 8 pixels, its camera"),
    "missing key": (
        lambda d: edit(d, "val", lambda c: c["frames"][1].pop("transform_matrix")),
        r"val.json: frames\[1\].transform_matrix: this key is missing",
    ),
    "skewed camera": (
        lambda d: edit(d, "train", lambda c: c["frames"][0]["transform_matrix"][0].__setitem__(0, 3.0)),
        r"frames\[0\].transform_matrix: expected a 4 x 4 rigid",
    ),
    "camera that moves": (
        lambda d: edit(d, "train", lambda c: c["frames"][2]["transform_matrix"][0].__setitem__(3, 3.0)),
        r"frames\[2\].*camera 0 stands elsewhere than in the other frames",
    ),
    "focal length as text": (
        lambda d: edit(d, "train", lambda c: c["frames"][0].update(fl_x="wide")),
        r"frames\[0\].fl_x: expected a number, found 'wide'",
    ),
    "twice the same frame": (
        lambda d: edit(d, "test", lambda c: c["frames"].append(c["frames"][0])),
        "appear twice",
    ),
    "missing parameters": (lambda d: (d / "flame_param/00002.npz").unlink(), "00002.npz: no such head parameter file"),
    "missing model": (lambda d: (d / "head_model.npz").unlink(), "head_model.npz: no such head model"),
    "broken model": (lambda d: (d / "head_model.npz").write_bytes(b"PK"), "not a readable .npz"),
}


@pytest.mark.parametrize("name", BREAKAGES)
def test_broken_datasets_are_named_in_one_line(dataset, name):
    damage, says = BREAKAGES[name]
    damage(dataset)
    with pytest.raises(InputError, match=says) as caught:
        read(dataset)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("split", ["train", "val", "test"])
def test_paths_that_windows_writes_name_the_same_files(written, dataset, split):
    def as_windows_writes(content):
        for entry in content["frames"]:
            for key in ("file_path", "fg_mask_path", "flame_param_path"):
                entry[key] = entry[key].replace("/", "\\")

    expected = read(written)
    before = files_digest(dataset)
    edit(dataset, split, as_windows_writes)
    found = read(dataset)
    assert found.frames == expected.frames
    digests = [files_digest(dataset)]
    (dataset / found.split(split)[0].image).touch()
    digests.append(files_digest(dataset))
    assert len({before, *digests}) == 3  # the job that read the image runs again


def test_a_backslash_in_the_name_of_a_file_stays(dataset):
    name = "images/a\\b.png"
    (dataset / read(dataset).split("train")[0].image).rename(dataset / name)
    edit(dataset, "train", lambda content: content["frames"][0].update(file_path=name))
    assert name in {frame.image for frame in read(dataset).frames}
