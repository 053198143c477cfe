"""Clips: what is in them, and their files."""

import cv2
import numpy as np
import pytest
from avatars import CAMERA, ball_avatar
from PIL import Image

from carigs.cli.main import main
from carigs.errors import InputError
from carigs.library import HeadAvatar, orbit
from carigs.library.clips import captured_sequence, gamma_sweep, turntable, write_clip
from carigs.splat.avatar import save_avatar


@pytest.fixture(scope="module")
def avatar():
    return HeadAvatar(ball_avatar())


def test_the_level_grows_and_falls(avatar):
    images = list(gamma_sweep(avatar, CAMERA, 4, 0.2, timestep=1))
    for image, level in zip(images, (0, 0.1, 0.2, 0.1), strict=True):
        np.testing.assert_allclose(image, avatar.render(CAMERA, level=level, timestep=1), atol=1e-6)


def test_cameras_and_timesteps_follow_each_other(avatar):
    cameras = orbit(avatar, 3, size=32)
    for image, camera in zip(turntable(avatar, cameras, level=0.1), cameras, strict=True):
        np.testing.assert_allclose(image, avatar.render(camera, level=0.1), atol=1e-6)
    for t, image in enumerate(captured_sequence(avatar, CAMERA, level=0.1)):
        np.testing.assert_allclose(image, avatar.render(CAMERA, level=0.1, timestep=t), atol=1e-6)
    assert t == 2


def read(file):
    if file.suffix in (".gif", ".webp"):
        with Image.open(file) as clip:
            for i in range(clip.n_frames):
                clip.seek(i)
                yield np.asarray(clip.convert("RGB")) / 255
        return
    video = cv2.VideoCapture(str(file))
    while True:
        found, frame = video.read()
        if not found:
            return
        yield frame[..., ::-1] / 255


@pytest.mark.parametrize("suffix", [".mp4", ".webm", ".gif", ".webp"])
def test_the_file_holds_the_images(tmp_path, suffix):
    """A disc that moves and changes its colour, so that no two images are the same."""
    y, x = np.mgrid[:64, :96]
    images = []
    for k in range(6):
        inside = (x - 20 - 10 * k) ** 2 + (y - 32) ** 2 < 200
        images.append(np.where(inside[..., None], [0.2 + 0.1 * k, 0.6, 0.3], 1.0).astype(np.float32))
    file = tmp_path / f"clip{suffix}"
    assert write_clip(file, iter(images), 12) == 6
    found = list(read(file))
    assert len(found) == 6
    for image, expected in zip(found, images, strict=True):
        assert image.shape == expected.shape and np.abs(image - expected).mean() < 0.02
    if suffix == ".gif":
        with Image.open(file) as clip:
            assert clip.info["duration"] in (80, 83, 90) and clip.info["loop"] == 0


def test_other_formats_and_empty_clips_are_refused(tmp_path):
    with pytest.raises(InputError, match=r"a clip is one of \.mp4"):
        write_clip(tmp_path / "clip.avi", [], 24)
    for suffix in (".mp4", ".gif"):
        with pytest.raises(InputError, match="0 images"):
            write_clip(tmp_path / f"clip{suffix}", [], 24)
    assert not list(tmp_path.iterdir())


@pytest.fixture(scope="module")
def file(avatar, tmp_path_factory):
    path = tmp_path_factory.mktemp("avatar") / "avatar.npz"
    save_avatar(path, avatar.avatar)
    return path


@pytest.mark.parametrize(
    ("options", "count"),
    [
        (["--seconds", "0.5", "--level", "0.1"], 12),
        (["--sweep", "orbit", "--seconds", "0.25", "--degrees", "90", "--region", "scalp=0.1"], 6),
        (["--sweep", "sequence", "--azimuth", "20"], 3),
    ],
)
def test_the_command_writes_a_clip(file, tmp_path, capsys, options, count):
    assert main(["export", str(file), str(tmp_path / "clip.webp"), "--size", "32", *options]) == 0
    with Image.open(tmp_path / "clip.webp") as clip:
        assert clip.n_frames == count and clip.size == (32, 32)
    assert f"clip.webp: {count} images" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["clip.avi"], "clip.avi: a clip is one of"),
        (["clip.gif", "--seconds", "0"], "expected 1 to"),
        (["clip.gif", "--seconds", "nan"], "--seconds"),
        (["clip.gif", "--size", "100000"], "--size 100000"),
        (["clip.gif", "--region", "beak=0.2"], "there is no beak"),
        (["clip.gif", "--timestep", "9"], "timestep=9"),
        (["clip.gif", "--sweep", "sequence", "--timestep", "1"], "--sweep sequence shows all timesteps"),
        (["clip.gif", "--elevation", "90"], "elevation=90"),
        (["clip.gif", "--level", "nan"], "finite"),
    ],
)
def test_mistakes_are_one_line(file, tmp_path, monkeypatch, capsys, arguments, problem):
    monkeypatch.chdir(tmp_path)
    assert main(["export", str(file), *arguments]) == 1
    error = capsys.readouterr().err
    assert problem in error and error.count("\n") == 1
    assert not (tmp_path / "clip.gif").exists()
