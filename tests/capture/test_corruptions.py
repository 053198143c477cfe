"""Corruptions of a dataset: each alone gives the error that names its file and field, and one pass finds them all.

They are made in a folder that holds everything, and in a union folder, whose index names the files of the folder beside
it by `../`. Every frame states its own intrinsics.
"""

import json
import os
import re
import shutil
import struct
import zlib
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from miniature import write_ball

from carigs.capture import read_dataset
from carigs.capture.images import write_png
from carigs.errors import InputError


class Place(NamedTuple):
    """The frame of a timestep that is spoilt."""

    folder: Path
    """Of the images."""
    entries: list[Any]
    """Entries of transforms_train.json."""
    position: int
    """Of camera 0 at the timestep; camera 2 follows."""
    timestep: int

    @property
    def image(self) -> Path:
        return self.folder / f"images/{self.timestep:05d}_00.png"

    @property
    def mask(self) -> Path:
        return self.folder / f"fg_masks/{self.timestep:05d}_00.png"

    @property
    def parameters(self) -> Path:
        return self.folder / f"flame_param/{self.timestep:05d}.npz"


def put(place: Place, **values: Any) -> None:
    place.entries[place.position].update(values)


def drop(place: Place, key: str) -> None:
    del place.entries[place.position][key]


def matrix(place: Place, change: Callable[[np.ndarray], Any]) -> None:
    changed = change(np.array(place.entries[place.position]["transform_matrix"]))
    put(place, transform_matrix=changed.tolist() if isinstance(changed, np.ndarray) else changed)


def replaced(m: np.ndarray, value: Any) -> list:
    rows = m.tolist()
    rows[1][2] = value
    return rows


def cut(file: Path) -> None:
    file.write_bytes(file.read_bytes()[:-20])


def huge(file: Path) -> None:
    """A header that claims 30 000 x 30 000 pixels, with the right checksum."""
    content = bytearray(file.read_bytes())
    content[16:24] = struct.pack(">II", 30_000, 30_000)
    content[29:33] = struct.pack(">I", zlib.crc32(content[12:29]))
    file.write_bytes(content)


def arrays(place: Place, **values: Any) -> None:
    with np.load(place.parameters) as content:
        changed = {**content, **values}
    np.savez(place.parameters, **{key: value for key, value in changed.items() if value is not None})


def link(file: Path, target: str | Path) -> None:
    file.unlink()
    file.symlink_to(target)


def folder_instead(file: Path) -> None:
    file.unlink()
    file.mkdir()


WHERE, IMAGE, MASK, HEAD = (
    r"train\.json: frames\[#\]",
    r"images/@_00\.png",
    r"fg_masks/@_00\.png",
    r"flame_param/@\.npz",
)
"""# stands for the position in the file, @ for the timestep."""
CORRUPTIONS: dict[str, tuple[Callable[[Place], object], str]] = {
    "no timestep": (partial(drop, key="timestep_index"), rf"{WHERE}\.timestep_index: this key is missing"),
    "timestep -1": (partial(put, timestep_index=-1), rf"{WHERE}\.timestep_index: .*0 or larger, found -1"),
    "timestep 0.5": (partial(put, timestep_index=0.5), rf"{WHERE}\.timestep_index: expected a whole number"),
    "timestep 1e12": (partial(put, timestep_index=1e12), rf"{WHERE}\.timestep_index: 1e\+12 is larger than"),
    "timestep as text": (partial(put, timestep_index="first"), rf"{WHERE}\.timestep_index: expected a number"),
    "no camera": (partial(drop, key="camera_index"), rf"{WHERE}\.camera_index: this key is missing"),
    "camera null": (partial(put, camera_index=None), rf"{WHERE}\.camera_index: expected a number, found None"),
    "no image path": (partial(drop, key="file_path"), rf"{WHERE}\.file_path: this key is missing"),
    "image path as number": (partial(put, file_path=7), rf"{WHERE}\.file_path: expected a string, found 7"),
    "absolute image path": (partial(put, file_path="/a.png"), rf"{WHERE}\.file_path: .*no path inside"),
    "image path far outside": (partial(put, file_path="../../a.png"), rf"{WHERE}\.file_path: .*no path inside"),
    "image path around a corner": (partial(put, file_path="../x/../../a.png"), rf"{WHERE}\.file_path: .*no path"),
    "image far outside by backslashes": (partial(put, file_path="..\\..\\a.png"), rf"{WHERE}\.file_path: .*no path"),
    "image outside, both slashes": (partial(put, file_path="..\\x/..\\../a.png"), rf"{WHERE}\.file_path: .*no path"),
    "image on a drive": (partial(put, file_path="C:\\images\\a.png"), rf"{WHERE}\.file_path: .*no path inside"),
    "image on a share": (partial(put, file_path="\\\\server\\a.png"), rf"{WHERE}\.file_path: .*no path inside"),
    "image in no folder beside": (partial(put, file_path="../other/a.png"), r"other/a\.png: no such image"),
    "image with a NUL": (partial(put, file_path="images/\0.png"), r"images/\\x00\.png: cannot be read"),
    "matte with a line break": (partial(put, fg_mask_path="a\nb.png"), r"a\\nb\.png: no such image"),
    "empty image path": (partial(put, file_path=""), rf"{WHERE}\.file_path: .*no path inside"),
    "matte path far outside": (partial(put, fg_mask_path="a/../../../b.png"), rf"{WHERE}\.fg_mask_path: .*no path"),
    "matte path as list": (partial(put, fg_mask_path=[]), rf"{WHERE}\.fg_mask_path: expected a string"),
    "no parameter path": (partial(drop, key="flame_param_path"), rf"{WHERE}\.flame_param_path: this key is missing"),
    "parameter path outside": (partial(put, flame_param_path="../../p.npz"), rf"{WHERE}\.flame_param_path: .*no path"),
    "no matrix": (partial(drop, key="transform_matrix"), rf"{WHERE}\.transform_matrix: this key is missing"),
    "matrix of three rows": (partial(matrix, change=lambda m: m[:3]), rf"{WHERE}\.transform_matrix: shape \(3, 4\)"),
    "text in the matrix": (partial(matrix, change=lambda m: replaced(m, "x")), rf"{WHERE}\.transform_matrix: "),
    "null in the matrix": (partial(matrix, change=lambda m: replaced(m, None)), rf"{WHERE}\.transform_matrix: "),
    "ragged matrix": (partial(matrix, change=lambda m: [*m.tolist()[:3], [0, 1]]), rf"{WHERE}\.transform_matrix: "),
    "mirrored": (partial(matrix, change=lambda m: m @ np.diag([-1, 1, 1, 1])), rf"{WHERE}\.transform_matrix: .*mirror"),
    "scaled": (partial(matrix, change=lambda m: 2 * m), rf"{WHERE}\.transform_matrix: .*last row"),
    "skewed": (partial(matrix, change=lambda m: m + 0.1 * np.eye(4)[:1].T), rf"{WHERE}\.transform_matrix: "),
    "far away": (partial(matrix, change=lambda m: m + 1e6 * np.eye(4)[:, :1] * np.eye(4)[3]),
                 rf"{WHERE}\.transform_matrix: .*m from the origin"),
    "elsewhere": (partial(matrix, change=lambda m: m + 0.3 * np.eye(4)[:, :1] * np.eye(4)[3]),
                  rf"{WHERE}\.transform_matrix: camera 0 stands elsewhere"),
    "focal length 0": (partial(put, fl_x=0), rf"{WHERE}\.fl_x: a focal length must be positive"),
    "negative focal length": (partial(put, fl_y=-150), rf"{WHERE}\.fl_y: a focal length must be positive"),
    "focal length as text": (partial(put, fl_x="wide"), rf"{WHERE}\.fl_x: expected a number, found 'wide'"),
    "focal length true": (partial(put, fl_x=True), rf"{WHERE}\.fl_x: expected a number, found True"),
    "focal length in metres": (partial(put, fl_x=0.05), rf"{WHERE}\.fl_x: .*field of view"),
    "principal point outside": (partial(put, cx=500), rf"{WHERE}\.cx: the principal point 500 lies outside"),
    "principal point above": (partial(put, cy=-3), rf"{WHERE}\.cy: the principal point -3 lies outside"),
    "normalised principal point": (partial(put, cx=0.5, cy=0.5), rf"{WHERE}\.cx, cy: .*shares of the image"),
    "no focal length": (partial(drop, key="fl_x"), rf"{WHERE}\.fl_x: this key is missing"),
    "no width": (partial(drop, key="w"), rf"{WHERE}\.w: this key is missing"),
    "focal length 1e308": (partial(put, fl_y=1e308), rf"{WHERE}\.fl_y: .*field of view of 0 degrees"),
    "field of view 0": (lambda p: (drop(p, "fl_x"), put(p, camera_angle_x=0)), rf"{WHERE}\.fl_x: .*focal lengths are"),
    "field of view as text": (lambda p: (drop(p, "fl_x"), put(p, camera_angle_x="90")),
                              rf"{WHERE}\.camera_angle_x: expected a number, found '90'"),
    "width 0": (partial(put, w=0), rf"{WHERE}\.w, h: 0 x 48 pixels"),
    "height 47.5": (partial(put, h=47.5), rf"{WHERE}\.h: expected a whole number"),
    "another height": (partial(put, h=50), rf"{IMAGE}: 40 x 48 pixels, its camera has 40 x 50"),
    "no object": (lambda p: p.entries.__setitem__(p.position, "frame"), rf"{WHERE}: expected an object"),
    "no image": (lambda p: p.image.unlink(), rf"{IMAGE}: no such image"),
    "image of junk": (lambda p: p.image.write_bytes(b"junk" * 50), rf"{IMAGE}: not a PNG or JPEG"),
    "empty image": (lambda p: p.image.write_bytes(b""), rf"{IMAGE}: not a PNG or JPEG"),
    "cut image": (lambda p: cut(p.image), rf"{IMAGE}: .*the end of the PNG is missing"),
    "small image": (lambda p: write_png(p.image, np.ones((8, 9, 3))), rf"{IMAGE}: 9 x 8 pixels, its camera"),
    "image with a huge header": (lambda p: huge(p.image), rf"{IMAGE}: 30000 x 30000 pixels"),
    "device as image": (lambda p: link(p.image, "/dev/zero"), rf"{IMAGE}: not a regular file"),
    "link to a text as image": (lambda p: link(p.image, "/etc/passwd"), rf"{IMAGE}: not a PNG or JPEG"),
    "link to itself as image": (lambda p: link(p.image, p.image), rf"{IMAGE}: cannot be read"),
    "pipe as matte": (lambda p: (p.mask.unlink(), os.mkfifo(p.mask)), rf"{MASK}: not a regular file"),
    "link to a device as parameters": (lambda p: link(p.parameters, "/dev/zero"), rf"{HEAD}: not a regular file"),
    "folder as image": (lambda p: folder_instead(p.image), rf"{IMAGE}: not a regular file"),
    "no matte": (lambda p: p.mask.unlink(), rf"{MASK}: no such image"),
    "cut matte": (lambda p: cut(p.mask), rf"{MASK}: .*the end of the PNG is missing"),
    "small matte": (lambda p: write_png(p.mask, np.ones((8, 9))), rf"{MASK}: 9 x 8 pixels, its camera"),
    "no parameters": (lambda p: p.parameters.unlink(), rf"{HEAD}: no such head parameter file"),
    "parameters of junk": (lambda p: p.parameters.write_bytes(b"junk"), rf"{HEAD}: not a readable .npz"),
    "no translation": (partial(arrays, translation=None), rf"{HEAD}: translation: this array is missing"),
    "rotation not a number": (partial(arrays, rotation=np.full((1, 3), np.nan)), rf"{HEAD}: rotation: not a finite"),
    "translation of 2 values": (partial(arrays, translation=np.zeros((1, 2))), rf"{HEAD}: translation: 2 values"),
    "too many expressions": (partial(arrays, expr=np.zeros((1, 101))), rf"{HEAD}: expr: 101 values, expected 100"),
    "expressions of text": (partial(arrays, expr=np.array(["smile"])), rf"{HEAD}: expr: holds texts"),
    "another vertex count": (partial(arrays, static_offset=np.zeros((1, 7, 3))), rf"{HEAD}: static_offset: shape"),
    "listed twice": (lambda p: p.entries.append(dict(p.entries[p.position])),
                     r"train\.json: frames\[\d+\]\.camera_index: timestep and camera appear twice: @_00"),
    "image of two frames": (lambda p: put(p, file_path=p.entries[p.position + 1]["file_path"]),
                            r"images/@_02\.png: file_path: is the image of two frames"),
    "two parameter files": (lambda p: p.entries[p.position + 1].update(flame_param_path="flame_param/00000.npz"),
                            r"flame_param/00000\.npz: flame_param_path: timestep @* ?\d+ has two parameter files"),
    "two sequences": (lambda p: p.entries[p.position + 1].update(sequence="EXP-9"),
                      r"train\.json: frames\[\d+\]\.sequence: timestep \d+ belongs to two sequences"),
}  # fmt: skip
FIRST = 1
"""Timestep of the first corruption."""
TIMESTEPS = len(CORRUPTIONS) + 3
BALL, UNION = "ball", "UNION2_ball"


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    """Two folders beside each other: the dataset, and a union of it."""
    family = tmp_path_factory.mktemp("family")
    ball, union = write_ball(family / BALL, TIMESTEPS), family / UNION
    union.mkdir()
    for index in ball.glob("transforms_*.json"):
        content = json.loads(index.read_text())
        for entry in content["frames"]:
            entry |= {key: f"../{BALL}/{value}" for key, value in entry.items() if key.endswith("_path")}
        (union / index.name).write_text(json.dumps(content))
    return family


@pytest.fixture(params=[BALL, UNION])
def dataset(request, written, tmp_path) -> Path:
    return Path(shutil.copytree(written, tmp_path / "family")) / request.param


def spoil(folder: Path, names: list[str]) -> list[str]:
    """Apply corruptions, each to a timestep of its own, and return what the errors must say."""
    images = folder.with_name(BALL)
    file = folder / "transforms_train.json"
    content, says = json.loads(file.read_text()), []
    positions = {entry["timestep_index"]: i for i, entry in reversed(list(enumerate(content["frames"])))}
    for name in names:
        timestep = FIRST + list(CORRUPTIONS).index(name)
        change, pattern = CORRUPTIONS[name]
        change(Place(images, content["frames"], positions[timestep], timestep))
        says.append(pattern.replace("@* ?", "").replace("#", str(positions[timestep])).replace("@", f"{timestep:05d}"))
    file.write_text(json.dumps(content))
    return says


def read(folder: Path, errors: list[InputError] | None = None):
    return read_dataset(folder, folder.with_name(BALL) / "head_model.npz", errors=errors)


def test_there_are_forty():
    assert len(CORRUPTIONS) >= 40


@pytest.mark.sample(40)
@pytest.mark.parametrize("name", CORRUPTIONS)
def test_each_alone_is_named(dataset, name):
    (says,) = spoil(dataset, [name])
    with pytest.raises(InputError, match=says) as caught:
        read(dataset)
    assert "\n" not in str(caught.value)


def test_one_pass_finds_all_and_keeps_the_rest(dataset):
    says, errors = spoil(dataset, list(CORRUPTIONS)), []
    capture = read(dataset, errors)
    for pattern in says:
        assert sum(bool(re.search(pattern, str(error))) for error in errors) == 1, pattern
    assert len(errors) == len(CORRUPTIONS)
    sound = {frame.timestep for frame in capture.frames if frame.split == "train" and frame.camera == 2}
    assert {0, TIMESTEPS - 2} <= sound and len(sound) > len(CORRUPTIONS) / 2
    assert len(capture.split("test")) == 3


def test_a_sound_dataset_has_no_errors(dataset):
    errors: list[InputError] = []
    assert len(read(dataset, errors).frames) == 3 * TIMESTEPS and errors == []
