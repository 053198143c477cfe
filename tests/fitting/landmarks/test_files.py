"""Files of landmarks: round trips, selection by number, refused contents."""

import importlib.util
import sys
import types

import numpy as np
import pytest

from carigs.errors import InputError
from carigs.fitting.landmarks.files import Landmarks, read_landmarks
from carigs.fitting.landmarks.providers import MediapipeDetector


def landmarks() -> Landmarks:
    random = np.random.default_rng(0)
    values = np.concatenate([random.uniform(0, 100, (3, 2, 5, 2)), random.uniform(0.1, 1, (3, 2, 5, 1))], axis=-1)
    return Landmarks(values, np.array([4, 0, 7]), np.array([8, 2]))


def test_a_file_is_read_as_it_was_written(tmp_path):
    landmarks().save(tmp_path / "landmarks.npz")
    found = read_landmarks(tmp_path / "landmarks.npz")
    for name in ("values", "timesteps", "cameras"):
        np.testing.assert_array_equal(getattr(found, name), getattr(landmarks(), name))


def test_nan_and_confidence_0_are_missing(tmp_path):
    written = landmarks()
    written.values[0, 0, 1, 0] = np.nan
    written.values[1, 1, 2, 2] = 0
    written.save(tmp_path / "landmarks.npz")
    found = read_landmarks(tmp_path / "landmarks.npz").values
    np.testing.assert_array_equal(found[[0, 1], [0, 1], [1, 2]], 0)
    assert np.count_nonzero(found[..., 2]) == 3 * 2 * 5 - 2


def test_frames_are_found_by_their_numbers():
    found = landmarks().at([0, 1, 4], [2, 3])
    np.testing.assert_array_equal(found[:, 0], [landmarks().values[1, 1], np.zeros((5, 3)), landmarks().values[0, 1]])
    np.testing.assert_array_equal(found[:, 1], 0)


@pytest.mark.parametrize(
    ("field", "value", "message"),
    [
        ("landmarks", np.zeros((3, 2, 5)), "landmarks: shape"),
        ("landmarks", np.array(1.0), "landmarks: shape"),
        ("landmarks", np.full((3, 2, 5, 3), 2.0), "confidence, from 0 to 1"),
        ("landmarks", np.full((3, 2, 5, 3), 1e7) * [1, 1, 0], "positions beyond"),
        ("timesteps", np.array([0, 1]), "timesteps: shape"),
        ("cameras", np.array([3, 3]), "cameras: a number appears twice"),
    ],
)
def test_impossible_landmarks_are_refused(tmp_path, field, value, message):
    written = landmarks()
    arrays = {"landmarks": written.values, "timesteps": written.timesteps, "cameras": written.cameras, field: value}
    np.savez(tmp_path / "landmarks.npz", **arrays)
    with pytest.raises(InputError, match=message):
        read_landmarks(tmp_path / "landmarks.npz")


@pytest.mark.skipif(importlib.util.find_spec("mediapipe") is not None, reason="mediapipe is installed")
def test_without_mediapipe_its_task_file_is_one_line(tmp_path):
    (tmp_path / "face_landmarker.task").write_bytes(b"")
    with pytest.raises(InputError, match=r"face_landmarker\.task: needs the package mediapipe"):
        MediapipeDetector(tmp_path / "face_landmarker.task")


@pytest.mark.parametrize("error", [RuntimeError("Unable to open zip archive.\nsource: x.cc"), ValueError("no model")])
def test_a_file_that_is_no_task_is_named(error, tmp_path, monkeypatch):
    """MediaPipe's own errors have several lines."""

    class Vision:
        FaceLandmarkerOptions = staticmethod(lambda **options: options)

        class FaceLandmarker:
            @staticmethod
            def create_from_options(_):
                raise error

    tasks = types.SimpleNamespace(vision=Vision, BaseOptions=lambda **options: options)
    monkeypatch.setitem(sys.modules, "mediapipe", types.SimpleNamespace(tasks=tasks))
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: object())
    (tmp_path / "face.task").write_bytes(b"PK")
    with pytest.raises(InputError, match=r"face\.task: not a task file of MediaPipe's face landmarks") as caught:
        MediapipeDetector(tmp_path / "face.task")
    assert "\n" not in str(caught.value)
