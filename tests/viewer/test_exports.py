"""Exports stay in their folder, replace nothing, and hold what the page shows."""

import threading

import numpy as np
import pytest
import trimesh
from avatars import CAMERA, ball_avatar
from PIL import Image

from carigs.capture.images import read_rgb
from carigs.errors import SettingsError
from carigs.library import HeadAvatar
from carigs.viewer import exports
from carigs.viewer.controls import controls_of
from carigs.viewer.exports import FORMATS, Export, ExportFolder, write_export
from carigs.viewer.scene import HeadScene
from carigs.viewer.state import State

HOSTILE = (
    "../out", "/etc/passwd", "a/b", "..", ".hidden", "", "a\0b", "con:x", "a\\..\\b", "x" * 65, "a b", "é", "a\n",
    "$(x)", "~", None, 3,
)  # fmt: skip


@pytest.fixture(scope="module")
def scene():
    return HeadScene(HeadAvatar(ball_avatar()))


@pytest.fixture
def values(scene):
    state = State(controls_of(scene.avatar))
    state.set("level", 0.2, 0.0)
    state.set("frame", 1, 0.0)
    return state.values


@pytest.mark.parametrize("name", HOSTILE)
def test_names_that_could_leave_the_folder_are_refused(tmp_path, name):
    with pytest.raises(SettingsError, match="name"):
        ExportFolder(tmp_path / "exports").new_file(name, ".png")
    assert list(tmp_path.iterdir()) == []


def test_nothing_is_replaced_and_links_are_not_followed(tmp_path, scene, values):
    folder, target = tmp_path / "exports", tmp_path / "target"
    folder.mkdir()
    (folder / "head.png").write_bytes(b"mine")
    (folder / "head-2.png").symlink_to(target)
    file = write_export(ExportFolder(folder), scene, Export("picture (.png)", "head", values, CAMERA), threading.Lock())
    assert file == folder / "head-3.png" and (folder / "head.png").read_bytes() == b"mine" and not target.exists()
    np.testing.assert_allclose(
        read_rgb(file), scene.avatar.render(CAMERA, level=0.2, timestep=1), atol=0.5 / 255 + 1e-4
    )


def test_the_number_of_files_is_limited(tmp_path, monkeypatch):
    monkeypatch.setattr(exports, "MAX_FILES", 3)
    folder = ExportFolder(tmp_path)
    for i in range(3):
        folder.new_file(f"a{i}", ".png")
    with pytest.raises(SettingsError, match="3 files"):
        folder.new_file("b", ".png")


@pytest.mark.parametrize("format", [name for name in FORMATS if "mesh" in name or "surfels" in name])
def test_geometry(tmp_path, scene, values, format):
    file = write_export(ExportFolder(tmp_path), scene, Export(format, "head", values, CAMERA), threading.Lock())
    assert file.suffix == FORMATS[format][0] and file.stat().st_size > 1000
    if "mesh (" in format:
        mesh = trimesh.load(file, process=False, maintain_order=True, force="mesh")
        np.testing.assert_allclose(mesh.vertices, scene.vertices(values), atol=1e-6)


@pytest.mark.parametrize(("kind", "count"), [("gamma sweep", "SWEEP_IMAGES"), ("turntable", "ORBIT_IMAGES")])
def test_clips(tmp_path, scene, values, monkeypatch, kind, count):
    monkeypatch.setattr(exports, count, 4)
    counted = []
    file = write_export(
        ExportFolder(tmp_path),
        scene,
        Export(f"{kind} (.webp)", "head", values, CAMERA),
        threading.Lock(),
        counted.append,
    )
    with Image.open(file) as clip:
        assert clip.n_frames == 4 and clip.size == (64, 64)
        clip.seek(2)
        shown = np.asarray(clip.convert("RGB")) / 255
    assert counted == [1, 2, 3, 4]
    if kind == "gamma sweep":  # the third of four images has the highest level
        expected = scene.avatar.render(CAMERA, level=0.2, timestep=1)
        assert np.abs(shown - expected).mean() < 0.05


def test_unknown_formats_are_refused(tmp_path, scene, values):
    with pytest.raises(SettingsError, match="format"):
        write_export(ExportFolder(tmp_path), scene, Export("../x", "head", values, CAMERA), threading.Lock())


def test_the_page_is_written(tmp_path, scene, values):
    file = write_export(ExportFolder(tmp_path), scene, Export("page (.html)", "head", values, CAMERA), threading.Lock())
    assert file.name == "head.html" and "carigs" in file.read_text()
