"""A synthetic video becomes a dataset. Landmarks and mattes are the true ones: networks have tests of their own."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from clips import quadrants, write_video
from PIL import Image

import carigs.tracking.video as video_room
from carigs.capture import read_dataset
from carigs.capture.held_out_poses import capture_pose_gap
from carigs.cli.main import main
from carigs.detection.face_tracking import FoundFace, ImageResult
from carigs.detection.likeness import COLOURS
from carigs.detection.mesh_indices import COUNT
from carigs.embedding import landmark_embedding
from carigs.head import HeadModel
from carigs.matting import MattedFrame
from carigs.matting.cut_dataset import write_cut_dataset
from carigs.settings import Toy, Track
from carigs.toy import head_model, make_subject
from carigs.tracking.sources import chosen_frames
from carigs.tracking.video import SHEET, TABLE, track_video
from evaluation.benchmarks.footage.motion import Talk
from evaluation.benchmarks.footage.oracle_landmarks import EXACT, oracle_landmarks
from evaluation.benchmarks.footage.rendering import before, person
from evaluation.benchmarks.footage.scenes import orbit, talk, three

SIDE, SECONDS, FPS = 128, 2, 10


@pytest.fixture(scope="module")
def recorded(tmp_path_factory):
    """A video of the toy before a grey wall, its truth and its mattes."""
    subject = make_subject(Toy(supersampling=1, texture_size=256, hair_strands=200))
    truth = talk(subject.model, subject.shape, SIDE, Talk(seconds=SECONDS, fps=FPS))
    wall = (np.full((SIDE, SIDE, 3), 0.6) for _ in truth.parameters)
    frames, mattes = zip(*before(person(subject, truth), wall), strict=True)
    folder = tmp_path_factory.mktemp("video")
    return write_video(folder / "me.avi", frames, codec="MJPG", fps=FPS), truth, mattes, folder


@pytest.fixture
def without_networks(monkeypatch, recorded):
    """Landmarks by the truth, and the true mattes."""
    _, truth, mattes, _ = recorded
    use_truth(monkeypatch, truth, lambda frame: mattes[frame.number])


def use_truth(monkeypatch, truth, matte):
    """Put the true landmarks and mattes in the place of networks; images are asked for camera after camera."""
    embedding = landmark_embedding(truth.model)
    places = oracle_landmarks(truth, embedding.points(truth.model), EXACT).values[..., :2].swapaxes(0, 1)
    found = np.zeros((*places.shape[:2], COUNT, 3), np.float32)
    found[:, :, embedding.landmarks, :2] = places
    in_order = iter(found.reshape(-1, COUNT, 3))

    def follow(images, networks):
        for _ in images:
            points = next(in_order)
            inside = points[embedding.landmarks, :2]
            box = np.concatenate([inside.min(axis=0), inside.max(axis=0)])
            yield ImageResult(FoundFace(points, 1.0, box, np.ones(COLOURS, np.float32)), 1, False)

    def matted(footage, coarse):
        for frame in footage:
            alpha = matte(frame).astype(np.float32) / 255
            yield MattedFrame(frame, alpha, frame.image.astype(np.float32) / 255)

    monkeypatch.setattr(video_room, "load_face_networks", lambda folder: None)
    monkeypatch.setattr(video_room, "load_person_segmenter", lambda folder: None)
    monkeypatch.setattr(video_room, "set_upright", lambda footage, networks: footage)
    monkeypatch.setattr(video_room, "set_photographs_upright", lambda photographs, networks: photographs)
    monkeypatch.setattr(video_room, "follow_face", follow)
    monkeypatch.setattr(video_room, "matted_frames", matted)


@pytest.mark.slow
def test_a_video_becomes_a_dataset_that_studies_read(recorded, without_networks, tmp_path):
    video, truth, _, _ = recorded
    truth.model.save(tmp_path / "head.npz")
    settings = Track(video=str(video), head_model=str(tmp_path / "head.npz"), frame_rate=10)
    report = track_video(settings, tmp_path / "dataset")
    assert report.frames == report.tracked == SECONDS * FPS
    dataset = read_dataset(tmp_path / "dataset", tmp_path / "dataset" / "head_model.npz", background=1.0)
    assert len(dataset.frames) == SECONDS * FPS
    assert {frame.split for frame in dataset.frames} == {"train", "val", "test"}
    # What is below the chin is there, and is not with `capture.body=cut`; the face stays.
    write_cut_dataset(tmp_path / "cut", dataset)
    cut = read_dataset(tmp_path / "cut", tmp_path / "cut" / "head_model.npz", background=1.0)
    face = np.median(_landmarks(truth, 0), axis=0).astype(int)
    for capture, lowest in ((dataset, 1), (cut, 0)):
        matte = capture.foreground(capture.frames[0])
        assert matte[face[1], face[0]] > 0.9 and matte[-1].max() == lowest
    # The person's own head model is the one that poses the parameters.
    own = HeadModel.load(tmp_path / "dataset" / "head_model.npz")
    assert own.v_template.shape == truth.model.v_template.shape
    assert (tmp_path / "dataset" / SHEET).stat().st_size > 1000
    text = (tmp_path / "dataset" / TABLE).read_text()
    assert "lips" in text and "px" in text
    # The table, the terminal and the report of a study say the same of the held-out poses.
    assert report.held_out in text and report.held_out == str(capture_pose_gap(dataset))
    # A clip of two seconds is too short, and is said to be.
    assert any("longer" in line for line in report.advice)


def filmed(kind, subject, seconds):
    """Truth, and the frames of each camera, of the toy before a grey wall."""
    truth = kind(subject.model, subject.shape, SIDE, Talk(seconds=seconds, fps=FPS))
    frames = []
    for camera in range(len(truth.cameras[0])):
        wall = (np.full((SIDE, SIDE, 3), 0.6) for _ in truth.parameters)
        frames.append([frame for frame, _ in before(person(subject, truth, camera), wall)])
    truth.model.save(Path("head.npz"))
    return truth, frames


def all_person(frame):
    return np.full(frame.image.shape[:2], 255)


@pytest.fixture
def subject(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return make_subject(Toy(supersampling=1, texture_size=256, hair_strands=200))


@pytest.mark.slow
def test_three_videos_become_one_dataset(subject, monkeypatch):
    truth, frames = filmed(three, subject, 1.2)
    Path("cameras").mkdir()
    for camera, images in enumerate(frames):
        write_video(Path("cameras") / f"{camera}.avi", images, codec="MJPG", fps=FPS)
    use_truth(monkeypatch, truth, all_person)
    report = track_video(Track(video="cameras", head_model="head.npz", frame_rate=FPS), Path("dataset"))
    assert report.kind.startswith("3 cameras that stand still") and report.frames == report.tracked == 36
    assert "1.avi\nregion" in report.errors
    dataset = read_dataset("dataset", "dataset/head_model.npz", background=1.0)
    assert len(dataset.frames) == 36 and len(dataset.cameras) == 3
    for timestep in range(12):  # no camera is lost to validation
        assert len({dataset.frame_at[timestep, camera].split for camera in range(3)}) == 1
    # Each frame shows the head of its own camera.
    angles = [np.degrees(np.arctan2(*camera.centre[[0, 2]])) for camera in dataset.cameras.values()]
    np.testing.assert_allclose(np.diff(angles), [35, 35], atol=3)


@pytest.mark.slow
def test_photographs_of_several_sizes_become_one_timestep(subject, monkeypatch):
    truth, [frames] = filmed(orbit, subject, 1.0)
    Path("photographs").mkdir()
    for number, image in enumerate(frames):
        Image.fromarray(image[: SIDE - number % 2]).save(f"photographs/{number}.png")
    use_truth(monkeypatch, truth, all_person)
    report = track_video(Track(video="photographs", head_model="head.npz"), Path("dataset"))
    assert report.kind == "photographs of one moment: the images have several sizes"
    assert len(report.focal_lengths) == 2 and report.tracked == 10
    dataset = read_dataset("dataset", "dataset/head_model.npz", background=1.0)
    assert {frame.timestep for frame in dataset.frames} == {0} and len(dataset.cameras) == 10
    assert [dataset.cameras[c].height for c in (0, 1)] == [SIDE, SIDE - 1]
    assert [frame.camera for frame in dataset.frames if frame.split != "train"] == [4]


def _landmarks(truth, timestep):
    points = landmark_embedding(truth.model).points(truth.model)
    return oracle_landmarks(truth, points, EXACT).values[timestep, 0, :, :2]


@pytest.mark.parametrize(("rate", "every"), [(25, 1), (12.5, 2), (12, 3), (5, 5), (100, 1)])
def test_every_nth_frame_is_used(tmp_path, rate, every):
    video = write_video(tmp_path / "v.avi", 3 * quadrants(20, 160, 120), codec="MJPG", fps=25)
    footage = chosen_frames(video, rate, 80)
    assert footage.numbers == tuple(range(0, 60, every)) and (footage.width, footage.height) == (80, 60)


@pytest.mark.parametrize(
    ("name", "said"),
    [("missing.mp4", "missing.mp4"), ("folder", "is empty"), ("short.avi", "0.9 s long|at least 1 s|at least 10")],
)
def test_what_is_no_video_of_a_second_is_one_line(tmp_path, capfd, monkeypatch, name, said):
    monkeypatch.setattr(video_room, "load_face_networks", lambda folder: None)
    monkeypatch.setattr(video_room, "load_person_segmenter", lambda folder: None)
    (tmp_path / "folder").mkdir()
    write_video(tmp_path / "short.avi", quadrants(11), codec="MJPG", fps=25)
    head_model().save(tmp_path / "head.npz")
    command = ["track", str(tmp_path / name), "--head-model", str(tmp_path / "head.npz"), "-o", str(tmp_path / "out")]
    assert main(command) == 1
    printed = capfd.readouterr().err
    assert re.search(said, printed) and len(printed.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists() and not [*tmp_path.glob(".out*")]


def test_a_folder_with_something_in_it_is_refused_first(tmp_path, capfd):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "transforms_train.json").write_text(json.dumps({}))
    assert main(["track", "no.mp4", "--head-model", "no.npz", "-o", str(tmp_path / "out")]) == 1
    assert "not empty" in capfd.readouterr().err
