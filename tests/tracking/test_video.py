"""A synthetic video becomes a dataset. Landmarks and mattes are the true ones: networks have tests of their own."""

import json
import re

import numpy as np
import pytest
from clips import quadrants, write_video

import carigs.tracking.video as video_room
from carigs.capture import read_dataset
from carigs.cli.main import main
from carigs.detection.face_tracking import ImageResult
from carigs.detection.mesh_indices import COUNT
from carigs.embedding import landmark_embedding
from carigs.head import HeadModel
from carigs.matting import MattedFrame
from carigs.settings import Toy, Track
from carigs.toy import head_model, make_subject
from carigs.tracking.sources import chosen_frames
from carigs.tracking.video import SHEET, TABLE, track_video
from evaluation.benchmarks.footage.motion import Talk
from evaluation.benchmarks.footage.oracle_landmarks import EXACT, oracle_landmarks
from evaluation.benchmarks.footage.rendering import before, person
from evaluation.benchmarks.footage.scenes import talk

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
    embedding = landmark_embedding(truth.model)
    found = np.zeros((len(truth.parameters), COUNT, 3), np.float32)
    places = oracle_landmarks(truth, embedding.points(truth.model), EXACT).values[:, 0]
    found[:, embedding.landmarks, :2] = places[..., :2]

    def follow(images, networks):
        for points, _ in zip(found, images, strict=True):
            inside = points[embedding.landmarks, :2]
            box = np.concatenate([inside.min(axis=0), inside.max(axis=0)])
            yield ImageResult((points, 1.0, box), 1, False)

    def matted(footage, coarse):
        for frame, matte in zip(footage, mattes, strict=True):
            yield MattedFrame(frame, matte.astype(np.float32) / 255, frame.image.astype(np.float32) / 255)

    monkeypatch.setattr(video_room, "load_face_networks", lambda folder: None)
    monkeypatch.setattr(video_room, "load_person_segmenter", lambda folder: None)
    monkeypatch.setattr(video_room, "pymatting", lambda: None)
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
    # What is below the chin is cut off, the face is not.
    frame = dataset.frames[0]
    matte = dataset.foreground(frame)
    face = np.median(_landmarks(truth, 0), axis=0).astype(int)
    assert matte[face[1], face[0]] > 0.9 and matte[-1].max() == 0
    # The person's own head model is the one that poses the parameters.
    own = HeadModel.load(tmp_path / "dataset" / "head_model.npz")
    assert own.v_template.shape == truth.model.v_template.shape
    assert (tmp_path / "dataset" / SHEET).stat().st_size > 1000
    text = (tmp_path / "dataset" / TABLE).read_text()
    assert "lips" in text and "px" in text
    # A clip of two seconds is too short, and is said to be.
    assert any("longer" in line for line in report.advice)


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
    monkeypatch.setattr(video_room, "pymatting", lambda: None)
    (tmp_path / "folder").mkdir()
    write_video(tmp_path / "short.avi", quadrants(11), codec="MJPG", fps=25)
    head_model().save(tmp_path / "head.npz")
    command = ["track", str(tmp_path / name), "--head-model", str(tmp_path / "head.npz"), "-o", str(tmp_path / "out")]
    assert main(command) == 1
    printed = capfd.readouterr().err
    assert re.search(said, printed) and len(printed.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_a_folder_with_something_in_it_is_refused_first(tmp_path, capfd):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "transforms_train.json").write_text(json.dumps({}))
    assert main(["track", "no.mp4", "--head-model", "no.npz", "-o", str(tmp_path / "out")]) == 1
    assert "not empty" in capfd.readouterr().err
