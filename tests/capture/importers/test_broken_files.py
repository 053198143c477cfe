"""Files of other programs that are damaged or impossible: each error names the file and what is wrong with it."""

from __future__ import annotations

import shutil
import struct
from pathlib import Path

import numpy as np
import pytest
from stress.sound_files import captures
from stress.sound_files.ball import head_model

from carigs.capture.importers.cameras import read_cameras
from carigs.capture.importers.flame_tracks import read_flame_track, read_tracked_cameras
from carigs.capture.importers.images import FoundImage, find_images
from carigs.capture.importers.mesh_sequence import read_mesh_sequence
from carigs.errors import InputError


@pytest.fixture(scope="module")
def sound(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("sound")
    captures.write_sound_files(folder)
    return folder


@pytest.fixture
def folder(sound, tmp_path) -> Path:
    return Path(shutil.copytree(sound, tmp_path / "captures"))


def replace(file: Path, old: bytes | str, new: bytes | str) -> None:
    old, new = (text.encode() if isinstance(text, str) else text for text in (old, new))
    assert old in file.read_bytes()
    file.write_bytes(file.read_bytes().replace(old, new, 1))


TEXT = {
    "huge width": ("cameras.txt", "32 24", f"{'9' * 400} 24", r"cameras\.txt: camera 1: 9+ x 24|\.\.\."),
    "negative height": ("cameras.txt", "32 24", "32 -24", r"cameras\.txt: camera 1: 32 x -24 pixels"),
    "camera twice": ("cameras.txt", "\n2 PINHOLE", "\n1 PINHOLE", r"cameras\.txt: camera 1: there are two cameras"),
    "fewer cameras than stated": ("cameras.txt", "cameras: 2", "cameras: 3", r"2 cameras, its comment states 3"),
    "fewer images than stated": ("images.txt", "images: 2", "images: 9", r"2 images, its comment states 9"),
    "no lines of points": ("images.txt", "1.5 2.5 -1\n8", "8", r"the line after image \d+ lists no points"),
    "the root as name": ("images.txt", "left/0000.png", "/", None),
    "a dot as name": ("images.txt", "left/0000.png", ".", None),
}


@pytest.mark.parametrize("name", TEXT)
def test_a_text_model(folder, name):
    file, old, new, says = TEXT[name]
    replace(folder / "text/sparse/0" / file, old, new)
    if says is None:  # names are compared with those of images and never opened
        assert len(read_cameras(folder / "text/sparse/0")) == 2
        return
    with pytest.raises(InputError, match=says):
        read_cameras(folder / "text/sparse/0")


@pytest.mark.parametrize("kind", ["cameras", "images"])
@pytest.mark.parametrize("count", [0, 1, 3, 2**40, 2**64 - 1])
def test_a_binary_model_with_another_count(folder, kind, count):
    """Fewer than there are would leave images out without a word."""
    file = folder / f"binary/sparse/0/{kind}.bin"
    file.write_bytes(struct.pack("<Q", count) + file.read_bytes()[8:])
    with pytest.raises(InputError, match=rf"{kind}\.bin: not a readable file of COLMAP's {kind}"):
        read_cameras(folder / "binary/sparse/0")


def rewrite(file: Path, **values: np.ndarray | None) -> None:
    with np.load(file) as content:
        arrays = {**content, **values}
    np.savez(file, **{key: value for key, value in arrays.items() if value is not None})


VHAP = {
    "an offset without rows": ({"dynamic_offset": np.array(0.0)}, "dynamic_offset: 1 rows, expected 3"),
    "timesteps of 5000 digits": ({"timestep_id": np.array(["9" * 5000, "1", "2"])}, "timestep_id: expected 3 differ"),
    "timestep 10^10": ({"timestep_id": np.array(["0", "1", "10000000000"])}, "timestep_id: expected 3 different"),
    "a timestep as a word": ({"timestep_id": np.array(["0", "1", "two"])}, "timestep_id: expected 3 different"),
    "a row less": ({"jaw_pose": np.zeros((2, 3))}, "jaw_pose: shape"),
    "no expressions": ({"expr": None}, "expr: this array is missing"),
    "expressions without rows": ({"expr": np.array(1.0)}, "expr: shape|rotation: shape"),
}


@pytest.mark.parametrize("name", VHAP)
def test_a_result_of_vhap(folder, name):
    values, says = VHAP[name]
    file = folder / "tracked_flame_params_0.npz"
    rewrite(file, **values)
    with pytest.raises(InputError, match=rf"tracked_flame_params_0\.npz: ({says})"):
        read_flame_track(file, head_model())


TRACKER = {
    "no rotation": ({"jaw": np.zeros((1, 6))}, "jaw: no rotation"),
    "parallel rows": ({"eyes": np.ones((1, 12))}, "eyes: no rotation"),
    "rows that overflow": ({"jaw": np.full((1, 6), 1e300)}, "jaw: no rotation"),
    "a camera with skew": ({"K": np.array([[50, 3, 16], [0, 50, 12], [0, 0, 1.0]])}, "K: .*without skew"),
    "a camera of nothing": ({"K": np.zeros((3, 3))}, "K: "),
}


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("name", TRACKER)
def test_a_frame_of_metrical_tracker(folder, name):
    values, says = TRACKER[name]
    rewrite(folder / "metrical/00001.npz", **values)
    image = folder / "capture/images/left/0001.png"
    with pytest.raises(InputError, match=rf"metrical/00001\.npz: {says}"):
        read_flame_track(folder / "metrical", head_model())
        read_tracked_cameras(folder / "metrical", [FoundImage(image, 1, "left")])


@pytest.mark.parametrize("line", ["v nan 0 0", "v 1e20 0 0", "v inf 0 0"])
def test_a_vertex_that_no_face_names_counts_in_a_sequence(folder, line):
    """It is part of the mean and of the principal components."""
    for file in (folder / "capture/meshes").iterdir():
        file.write_text(file.read_text() + ("\n" + line if file.stem == "frame_1" else "\nv 0 0 0"))
    with pytest.raises(InputError, match=r"frame_1\.obj: vertices: vertex 42 is not finite, or 10000 m or more"):
        read_mesh_sequence(folder / "capture/meshes")


@pytest.mark.parametrize("name", ["9" * 200, "10000000000"])
def test_timesteps_that_no_index_can_hold(folder, name):
    for file, read in (
        (folder / "capture/meshes/frame_1.obj", read_mesh_sequence),
        (folder / "track/00001.npz", lambda track: read_flame_track(track, head_model())),
    ):
        file.rename(file.with_stem(name))
        with pytest.raises(InputError, match=f"{name}.* end with different numbers"):
            read(file.parent)
    image = folder / "capture/images/left/0001.png"
    image.rename(image.with_stem(name))
    with pytest.raises(InputError, match="images are called CAMERA/TIMESTEP"):
        find_images(folder / "capture/images")


def test_an_image_that_is_no_file_is_named_before_anything_is_written(folder):
    image = folder / "capture/images/left/0001.png"
    image.unlink()
    image.symlink_to(image)
    with pytest.raises(InputError, match=r"left/0001\.png: cannot be read"):
        find_images(folder / "capture/images")
