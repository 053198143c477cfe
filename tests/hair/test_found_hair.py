"""The hair of a capture, and its file."""

from dataclasses import replace

import numpy as np
import pytest
from miniature import ball_cameras, write_ball

from carigs.capture import read_dataset
from carigs.capture.images import write_png
from carigs.errors import InputError
from carigs.hair import FoundHair, find_hair, load_hair
from carigs.hair.hull import Voxels
from carigs.hair.strands import Strands
from carigs.hair.views import PIXEL, read_views
from carigs.settings import Hair, Regions
from carigs.stages.hair import hair


@pytest.fixture(scope="module")
def subject(tmp_path_factory):
    folder = write_ball(tmp_path_factory.mktemp("ball"))
    capture = read_dataset(folder, folder / "head_model.npz")
    capture.save(folder / "capture.json")
    return capture, folder


def test_a_ball_without_hair_is_bald(subject, tmp_path, capsys):
    capture, folder = subject
    hair(Hair(), capture=folder / "capture.json", found=tmp_path / "hair.npz")
    found = load_hair(tmp_path / "hair.npz", len(capture.model.faces))
    scalp = capture.model.face_region("scalp")
    assert not found.covered.any() and not found.has_hair(scalp)
    assert found.clean.mean() > 0.9
    assert "0.0 % of the triangles beside the scalp are covered" in capsys.readouterr().out


def test_threads_do_not_change_the_result(subject, tmp_path):
    _, folder = subject
    for threads in (1, 3):
        hair(Hair(), capture=folder / "capture.json", found=tmp_path / f"{threads}.npz", threads=threads)
    assert (tmp_path / "1.npz").read_bytes() == (tmp_path / "3.npz").read_bytes()


def test_the_file_holds_what_was_found_and_is_checked(tmp_path):
    rng = np.random.default_rng(0)
    volume = Voxels(rng.normal(size=(5, 3)).astype(np.float32), rng.random(5, np.float32), 0.004)
    unit = np.eye(3, dtype=np.float32)[rng.integers(0, 3, 5)]
    strands = Strands(unit, rng.random(5, np.float32), -unit)
    covered, hidden, skin = rng.random((3, 7)) > 0.5
    found = FoundHair(rng.random(7, np.float32), covered, hidden, skin, volume, rng.random(5, np.float32), strands)
    file = tmp_path / "hair.npz"
    found.save(file)
    again = load_hair(file, 7)
    np.testing.assert_array_equal(again.texture, found.texture)
    np.testing.assert_array_equal(again.covered, found.covered)
    np.testing.assert_array_equal(again.hidden, found.hidden)
    np.testing.assert_array_equal(again.skin, found.skin)
    for values, expected in zip(again.strands, strands, strict=True):
        np.testing.assert_array_equal(values, expected)
    np.testing.assert_array_equal(again.volume.centres, volume.centres)
    assert again.volume.size == np.float32(volume.size)
    with pytest.raises(InputError, match=r"hair\.npz: covered"):
        load_hair(file, 8)
    replace(found, visible=np.full(5, np.nan, np.float32)).save(file)
    with pytest.raises(InputError, match=r"hair\.npz: visible"):
        load_hair(file, 7)
    replace(found, strands=strands._replace(direction=0.5 * unit)).save(file)
    with pytest.raises(InputError, match=r"hair\.npz: strand_direction: expected unit vectors"):
        load_hair(file, 7)
    file.write_bytes(b"no archive")
    with pytest.raises(InputError, match=r"hair\.npz"):
        load_hair(file, 7)


def test_frames_that_cannot_be_read_are_left_out(tmp_path):
    folder = write_ball(tmp_path / "ball")
    capture = read_dataset(folder, folder / "head_model.npz")
    train = capture.split("train")
    (folder / train[0].image).write_bytes(b"broken")
    write_png(folder / train[1].image, np.ones((4, 4, 3)))  # of another size than its camera
    assert len(read_views(capture)) == len(train) - 2
    for frame in train:
        (folder / frame.image).unlink()
    with pytest.raises(InputError, match="no training frame shows the head, for example 0"):
        find_hair(Hair(), capture)


def test_a_head_without_the_region_of_the_scalp_has_no_hair(subject):
    capture, _ = subject
    found = find_hair(Hair(regions=Regions(hair=("none",))), capture)
    assert len(found.volume.centres) == 0 and not found.has_hair(np.zeros(len(capture.model.faces), bool))


def test_cameras_that_look_away_are_left_out(tmp_path):
    cameras = ball_cameras()
    behind = np.diag([-1.0, 1, -1, 1])  # half a turn around the vertical axis
    cameras[0] = replace(cameras[0], camera_from_world=behind @ cameras[0].camera_from_world)
    folder = write_ball(tmp_path / "ball", cameras=cameras)
    capture = read_dataset(folder, folder / "head_model.npz")
    assert len(read_views(capture)) == len([frame for frame in capture.split("train") if frame.camera != 0])


def test_large_frames_are_scaled_to_the_pixels_of_strands(tmp_path):
    large = {number: camera.scaled(12) for number, camera in ball_cameras().items()}
    folder = write_ball(tmp_path / "ball", timesteps=2, cameras=large)
    views = read_views(read_dataset(folder, folder / "head_model.npz"))
    for view in views:
        assert view.visibility.pixel_size == pytest.approx(PIXEL, rel=0.02)
        camera = view.visibility.camera
        assert view.image.shape == (camera.height, camera.width, 3)
        on_mesh = view.visibility.face >= 0
        assert ((view.foreground > 0.5) == on_mesh).mean() > 0.98  # the smaller camera sees the same
