"""`carigs landmarks`: videos and folders, and what is said about others."""

import cv2
import numpy as np
import pytest
from drawn_faces import ColourMesh, Told, drawn, landmarks

from carigs.cli import landmarks as command
from carigs.cli.main import main
from carigs.detection import upright
from carigs.detection.crop import Crop
from carigs.detection.face_networks import FaceNetworks
from carigs.fitting.landmarks.files import read_landmarks
from carigs.tracking import sources

FACE = Crop(150, 120, 90, 0.0)


@pytest.fixture(autouse=True)
def networks(monkeypatch):
    made = FaceNetworks(Told([[FACE]] * 100), Told([]), ColourMesh())
    monkeypatch.setattr(command, "load_face_networks", lambda folder: made)


def write(file, image):
    file.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(file), image[..., ::-1])


def found(source, tmp_path):
    assert main(["landmarks", str(source), "-o", str(tmp_path / "found.npz")]) == 0
    return read_landmarks(tmp_path / "found.npz")


def test_a_folder_by_camera_and_timestep(tmp_path, capsys):
    for name in ("left/3", "left/7", "right/7"):
        write(tmp_path / "images" / f"{name}.png", drawn([FACE]))
    read = found(tmp_path / "images", tmp_path)
    assert read.timesteps.tolist() == [3, 7] and read.cameras.tolist() == [0, 1]
    assert read.values[..., 0, 2].tolist() == [[1, 0], [1, 1]]
    assert np.abs(read.values[1, 1, :, :2] - landmarks(FACE)[:, :2]).max() < 0.6
    assert "landmarks of 3 of 3 images" in capsys.readouterr().out


def test_a_folder_of_one_camera_in_the_order_in_which_people_count(tmp_path, capsys):
    for name, image in (("IMG 9", drawn([])), ("IMG 10", drawn([FACE]))):
        write(tmp_path / "images" / f"{name}.jpg", image)
    read = found(tmp_path / "images", tmp_path)
    assert read.timesteps.tolist() == [0, 1] and read.values[:, 0, 0, 2].tolist() == [0, 1]
    assert "camera 0: no face: 1 of 2 images (0)" in capsys.readouterr().err


def test_a_video(tmp_path):
    writer = cv2.VideoWriter(str(tmp_path / "me.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 25, (320, 240))
    for _ in range(12):
        writer.write(drawn([FACE])[..., ::-1].copy())
    writer.release()
    read = found(tmp_path / "me.avi", tmp_path)
    assert read.values.shape == (12, 1, 478, 3) and read.timesteps.tolist() == [*range(12)]
    assert np.abs(read.values[11, 0, :, :2] - landmarks(FACE)[:, :2]).max() < 2


def lying(monkeypatch, turns):
    """Faces that are upright after so many quarter turns clockwise."""
    for room in (upright, sources):
        monkeypatch.setattr(room, "quarter_turns", lambda images, networks: turns)


def test_a_video_that_lies_on_its_side_is_turned_and_says_so(tmp_path, monkeypatch, capsys):
    lying(monkeypatch, 1)
    writer = cv2.VideoWriter(str(tmp_path / "me.avi"), cv2.VideoWriter_fourcc(*"MJPG"), 25, (240, 320))
    for _ in range(12):
        writer.write(upright.turned(drawn([FACE]), 3)[..., ::-1].copy())
    writer.release()
    read = found(tmp_path / "me.avi", tmp_path)
    assert np.abs(read.values[11, 0, :, :2] - landmarks(FACE)[:, :2]).max() < 2
    assert "turned by 90 degrees, because its faces are on the side" in capsys.readouterr().err


def test_landmarks_of_images_that_lie_upside_down_stay_in_these_images(tmp_path, monkeypatch, capsys):
    lying(monkeypatch, 2)
    for name in ("left/3", "right/3"):
        write(tmp_path / "images" / f"{name}.png", upright.turned(drawn([FACE]), 2))
    read = found(tmp_path / "images", tmp_path)
    assert np.abs(read.values[0, 1, :, :2] - ((320, 240) - landmarks(FACE)[:, :2])).max() < 0.6
    assert "camera right: faces are upside down" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "content", "said"),
    [
        ("missing.mp4", None, "no such video"),
        ("text.mp4", b"no video", "not a video that carigs reads"),
        ("empty.mp4", b"", "not a video that carigs reads"),
        ("cut.avi", b"RIFF\0\0\0\0AVI LIST", "the decoder cannot open it"),
        ("list.mp4", b"#EXTM3U\n#EXTINF:1,\n/etc/passwd\n", "a playlist, which names other files"),
    ],
)
def test_what_is_no_footage_is_one_line(tmp_path, capfd, name, content, said):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    assert main(["landmarks", str(tmp_path / name), "-o", str(tmp_path / "found.npz")]) == 1
    lines = [line for line in capfd.readouterr().err.splitlines() if line.startswith("carigs:")]
    assert len(lines) == 1 and said in lines[0] and not (tmp_path / "found.npz").exists()


def test_no_face_at_all_is_an_error_and_writes_nothing(tmp_path, capsys):
    write(tmp_path / "images/a.png", drawn([]))
    assert main(["landmarks", str(tmp_path / "images"), "-o", str(tmp_path / "found.npz")]) == 1
    assert "no face in any of 1 images" in capsys.readouterr().err and not (tmp_path / "found.npz").exists()


def test_an_empty_folder_and_another_suffix_are_errors(tmp_path, capsys):
    (tmp_path / "images").mkdir()
    assert main(["landmarks", str(tmp_path / "images"), "-o", str(tmp_path / "found.npz")]) == 1
    assert "holds no images" in capsys.readouterr().err
    assert main(["landmarks", str(tmp_path / "images"), "-o", str(tmp_path / "found.json")]) == 1
    assert "written as .npz" in capsys.readouterr().err
