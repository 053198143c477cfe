"""`carigs matte`: frames and mattes in the layout that captures are read from."""

import cv2
import numpy as np
import pytest
from clips import write_video

from carigs.capture.images import read_grey, read_rgb8
from carigs.capture.importers.images import find_images
from carigs.cli import matte as command
from carigs.cli.main import main as carigs
from carigs.errors import WeightsMissing
from carigs.tracking import sources


@pytest.fixture
def disc(tmp_path):
    alpha = np.zeros((128, 128, 3), np.uint8)
    cv2.circle(alpha, (64, 72), 32, (255, 255, 255), -1, cv2.LINE_AA)
    image = np.where(alpha > 127, (120, 60, 30), (200, 210, 220)).astype(np.uint8)
    return write_video(tmp_path / "disc.mp4", [image] * 12), alpha[..., 0]


def test_a_video_before_a_plain_wall_becomes_images_and_mattes(tmp_path, disc, capsys):
    video, alpha = disc
    assert carigs(["matte", str(video), "-o", str(tmp_path / "out"), "--every", "4", "--background", "0"]) == 0
    assert "3 frames of 128 x 128 pixels" in capsys.readouterr().out
    found = find_images(tmp_path / "out" / "images")
    assert [image.timestep for image in found] == [0, 4, 8]
    assert np.abs(read_grey(tmp_path / "out/masks/00004_00.png") - alpha / 255).mean() < 0.02
    image = read_rgb8(tmp_path / "out/images/00004_00.png")
    assert image[2, 2].max() == 0 and np.abs(image[72, 64].astype(int) - (120, 60, 30)).max() < 12


def test_a_video_that_lies_on_its_side_is_turned_where_the_networks_are(tmp_path, monkeypatch, disc, capsys):
    video, alpha = disc
    monkeypatch.setattr(sources, "quarter_turns", lambda images, networks: 1)
    monkeypatch.setattr(command, "load_face_networks", lambda: None)
    assert carigs(["matte", str(video), "-o", str(tmp_path / "turned"), "--every", "4"]) == 0
    assert "disc.mp4: turned by 90 degrees, because its faces are on the side" in capsys.readouterr().err
    turned = read_grey(tmp_path / "turned/masks/00004_00.png")
    assert np.abs(turned - np.rot90(alpha, -1) / 255).mean() < 0.02

    def missing():
        raise WeightsMissing("none")

    monkeypatch.setattr(command, "load_face_networks", missing)
    assert carigs(["matte", str(video), "-o", str(tmp_path / "plain"), "--every", "4"]) == 0
    assert np.abs(read_grey(tmp_path / "plain/masks/00004_00.png") - alpha / 255).mean() < 0.02


def test_a_given_matte_wins(tmp_path, disc):
    video, _ = disc
    (tmp_path / "alpha").mkdir()
    for number in range(12):
        cv2.imwrite(str(tmp_path / f"alpha/{number}.png"), np.full((32, 32), 20 * number, np.uint8))
    assert carigs(["matte", str(video), "-o", str(tmp_path / "out"), "--alpha", str(tmp_path / "alpha")]) == 0
    for number in (0, 2, 11):
        assert (read_grey(tmp_path / f"out/masks/{number:05d}_00.png") * 255).round() == pytest.approx(20 * number)


def test_missing_mattes_are_refused_before_work(tmp_path, disc, capsys):
    video, _ = disc
    (tmp_path / "coarse").mkdir()
    assert carigs(["matte", str(video), "-o", str(tmp_path / "out"), "--coarse", str(tmp_path / "coarse")]) == 1
    assert "0 mattes for 12 frames" in capsys.readouterr().err and not (tmp_path / "out").exists()
