"""The networks of MediaPipe on rendered faces, where their weights are; and what is said where something is missing."""

import importlib.util
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from clips import quadrants, write_video
from shared_data import DATA, needs_data

from carigs.capture import read_dataset
from carigs.cli.main import main
from carigs.detection import collect, follow_face, load_face_networks
from carigs.detection import mesh_indices as indices
from carigs.errors import InputError, PackageMissing, WeightsMissing
from carigs.fitting.footage import frame_projections
from carigs.fitting.landmarks.embedding import read_embedding
from carigs.fitting.landmarks.files import read_landmarks
from carigs.fitting.landmarks.providers import find_landmarks
from carigs.fitting.triangulation import project
from carigs.head import pose
from carigs.system import extras
from carigs.weights.registry import registered
from carigs.weights.search import locate_weights

RUNTIME = importlib.util.find_spec("ai_edge_litert") is not None
needs_networks = [
    pytest.mark.weights,
    pytest.mark.skipif(
        not RUNTIME or locate_weights(registered("mediapipe_face"), None) is None,
        reason="pip install 'carigs[video]'; carigs weights fetch mediapipe_face",
    ),
]


@pytest.fixture
def nothing_found(tmp_path, monkeypatch):
    for name in ("HF_HUB_CACHE", "CARIGS_WEIGHTS"):
        monkeypatch.delenv(name, raising=False)
    for name in ("HF_HOME", "TORCH_HOME", "XDG_CACHE_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))


def test_without_the_package_the_extra_is_named(monkeypatch):
    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    with pytest.raises(PackageMissing, match=r"carigs\[video\]"):
        load_face_networks()


@pytest.mark.skipif(not RUNTIME, reason="needs ai-edge-litert")
def test_without_weights_the_command_is_named(nothing_found):
    with pytest.raises(WeightsMissing, match="carigs weights fetch mediapipe_face"):
        load_face_networks()


@pytest.mark.skipif(not RUNTIME, reason="needs ai-edge-litert")
def test_a_damaged_file_is_named(nothing_found, tmp_path):
    weights = registered("mediapipe_face")
    (tmp_path / weights.folder).mkdir()
    for file in weights.files:
        (tmp_path / weights.folder / file.name).write_bytes(bytes(file.bytes))
    with pytest.raises(InputError, match=r"face_detection_short_range.tflite: sha256 begins with"):
        load_face_networks(tmp_path)


@pytest.mark.skipif(not RUNTIME, reason="needs ai-edge-litert")
@pytest.mark.parametrize("command", [["landmarks"], ["track", "--head-model", "head.npz"]])
def test_a_folder_that_is_misspelt_is_named_and_not_passed_over(tmp_path, capsys, command):
    video = write_video(tmp_path / "me.avi", quadrants(12), codec="MJPG", fps=10)
    task = [*command, str(video), "-o", str(tmp_path / "out.npz"), "--weights", str(tmp_path / "wieghts")]
    assert main(task) == 1
    assert "wieghts: no such folder of weights" in capsys.readouterr().err


@pytest.fixture(scope="module")
def networks():
    return load_face_networks()


@pytest.fixture(scope="module")
def capture():
    return read_dataset(DATA / "ict_s1", DATA / "ict_model.npz")


def frontal(capture, count):
    """Frames of the camera that faces the head, with the true landmarks."""
    embedding, numbers = read_embedding(DATA / "real/ict_mediapipe_embedding.npz", capture.model, indices.COUNT)
    timesteps = sorted(capture.parameter_files)[:: len(capture.parameter_files) // count][:count]
    truth = np.stack([embedding.interpolate(pose(capture.model, capture.parameters(t))) for t in timesteps])
    pixels, _ = project(truth, frame_projections(capture, timesteps, [8]))
    return [capture.image8(capture.frame_at[t, 8]) for t in timesteps], pixels[:, 0], numbers


class TestNetworks:
    pytestmark = needs_networks

    @needs_data
    def test_landmarks_of_a_rendered_face_are_near_the_truth(self, networks, capture):
        images, truth, numbers = frontal(capture, 5)
        track = collect(follow_face(iter(images), networks))
        errors = np.linalg.norm(track.landmarks[:, numbers, :2] - truth, axis=-1)
        size = np.ptp(truth[0, :, 1])
        assert np.median(errors) < 0.02 * size and track.presence.min() > 0.9 and not track.notes()

    @needs_data
    @pytest.mark.parametrize("degrees", [-35, 35])
    def test_turned_images_have_turned_landmarks(self, networks, capture, degrees):
        image = frontal(capture, 1)[0][0]
        middle = (image.shape[1] / 2, image.shape[0] / 2)
        turn = cv2.getRotationMatrix2D(middle, degrees, 1)
        at_centres = turn.copy()
        at_centres[:, 2] += turn[:, :2] @ (0.5, 0.5) - 0.5
        white = (255, 255, 255)
        turned = cv2.warpAffine(
            image, at_centres, image.shape[1::-1], borderMode=cv2.BORDER_CONSTANT, borderValue=white
        )
        plain, found = (collect(follow_face([i], networks)).landmarks[0, :, :2] for i in (image, turned))
        assert np.median(np.linalg.norm(plain @ turn[:, :2].T + turn[:, 2] - found, axis=1)) < 1

    @needs_data
    def test_mirrored_images_have_mirrored_landmarks(self, networks, capture):
        image = frontal(capture, 1)[0][0]
        plain, mirrored = (collect(follow_face([i], networks)).landmarks[0] for i in (image, image[:, ::-1].copy()))
        back = mirrored[list(indices.MIRRORED), :2] * (-1, 1) + (image.shape[1], 0)
        assert np.median(np.linalg.norm(back - plain[:, :2], axis=1)) < 0.5

    @needs_data
    def test_a_large_image_has_the_landmarks_of_the_small_one(self, networks, capture):
        image = frontal(capture, 1)[0][0]
        large = image.repeat(8, axis=0).repeat(8, axis=1)
        small_points, large_points = (collect(follow_face([i], networks)).landmarks[0] for i in (image, large))
        assert np.median(np.linalg.norm(large_points / 8 - small_points, axis=1)) < 0.5

    @needs_data
    def test_a_small_face_is_found_by_the_second_detector(self, networks, capture):
        image = frontal(capture, 1)[0][0]
        wide = np.full((1800, 2400, 3), 255, np.uint8)
        wide[1200 : 1200 + image.shape[0], 700 : 700 + image.shape[1]] = image
        assert not networks.near(wide)
        track = collect(follow_face([wide], networks))
        expected = collect(follow_face([image], networks)).landmarks[0, :, :2] + (700, 1200)
        assert np.median(np.linalg.norm(track.landmarks[0, :, :2] - expected, axis=1)) < 0.7

    @needs_data
    def test_the_same_images_give_the_same_bytes(self, networks, capture):
        images = frontal(capture, 3)[0]
        first, again = (collect(follow_face(iter(images), n)) for n in (networks, load_face_networks()))
        assert first.landmarks.tobytes() == again.landmarks.tobytes()

    @pytest.mark.parametrize("shape", [(1, 1), (1, 5000), (300, 200)])
    @pytest.mark.parametrize("value", [0, 128, 255])
    def test_images_without_a_face_have_none(self, networks, shape, value):
        track = collect(follow_face([np.full((*shape, 3), value, np.uint8)] * 2, networks))
        assert not track.found.any() and track.notes() == ["no face: 2 of 2 images (0-1)"]

    @needs_data
    def test_the_fit_finds_them_by_itself_and_the_command_writes_the_same(self, capture, tmp_path, capsys):
        few = [frame for frame in capture.frames if frame.timestep < 2 and frame.camera in (7, 8)]
        found = find_landmarks(None, replace(capture, frames=tuple(few)))
        assert found.values.shape[2:] == (478, 3) and (found.values[..., 2] > 0.9).all()
        for frame in few:
            link = tmp_path / "images" / f"{frame.camera:02d}" / f"{frame.timestep:05d}.png"
            link.parent.mkdir(parents=True, exist_ok=True)
            link.symlink_to(Path(capture.root) / frame.image)
        assert main(["landmarks", str(tmp_path / "images"), "-o", str(tmp_path / "found.npz")]) == 0
        assert "landmarks of 4 of 4 images" in capsys.readouterr().out
        written = read_landmarks(tmp_path / "found.npz")
        np.testing.assert_allclose(written.values, found.values)
