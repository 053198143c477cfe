"""Embeddings: the files that come with FLAME and MediaPipe, the choice among landmarks, refused contents."""

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from small_head import small_head

from carigs.errors import InputError
from carigs.fitting.landmarks.embedding import read_embedding
from carigs.head import SurfacePoints

MODEL = small_head(subdivisions=2)


def faces_and_weights(count: int) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(count)
    return random.integers(0, len(MODEL.faces), count), random.dirichlet(np.ones(3), count)


def assert_points(found: SurfacePoints, faces: np.ndarray, weights: np.ndarray) -> None:
    expected = np.einsum("nk,nki->ni", weights, MODEL.v_template[MODEL.faces[faces]])
    np.testing.assert_allclose(found.interpolate(MODEL.v_template), expected, atol=1e-12)


def write_static_pickle(folder: Path, faces: np.ndarray, weights: np.ndarray) -> Path:
    content = {"lmk_face_idx": faces.astype(np.uint32), "lmk_b_coords": weights}
    (folder / "flame_static_embedding.pkl").write_bytes(pickle.dumps(content, 2))
    return folder / "flame_static_embedding.pkl"


def write_static_npz(folder: Path, faces: np.ndarray, weights: np.ndarray) -> Path:
    np.savez(folder / "static.npz", lmk_face_idx=faces, lmk_b_coords=weights)
    return folder / "static.npz"


def write_combined_npy(folder: Path, faces: np.ndarray, weights: np.ndarray) -> Path:
    """As DECA has it: the dynamic entries are tensors, the full ones have a leading axis."""
    torch = pytest.importorskip("torch")
    others = faces_and_weights(17)
    content = {
        "static_lmk_faces_idx": faces,
        "static_lmk_bary_coords": weights,
        "dynamic_lmk_faces_idx": torch.zeros((79, 17), dtype=torch.long),
        "dynamic_lmk_bary_coords": torch.zeros((79, 17, 3)),
        "full_lmk_faces_idx": np.concatenate([others[0], faces])[None],
        "full_lmk_bary_coords": np.concatenate([others[1], weights])[None],
    }
    np.save(folder / "landmark_embedding.npy", content)
    return folder / "landmark_embedding.npy"


@pytest.mark.parametrize("write", [write_static_pickle, write_static_npz, write_combined_npy])
@pytest.mark.parametrize(("points", "count"), [(51, 68), (51, 51), (53, 70)])
def test_static_points_are_the_landmarks_after_the_jaw_line(write, points, count, tmp_path):
    faces, weights = faces_and_weights(points)
    found, numbers = read_embedding(write(tmp_path, faces, weights), MODEL, count)
    assert_points(found, faces, weights)
    np.testing.assert_array_equal(numbers, np.arange(count - points, count))


def test_a_full_embedding_has_the_jaw_line(tmp_path):
    faces, weights = faces_and_weights(68)
    np.save(tmp_path / "full.npy", {"full_lmk_faces_idx": faces[None], "full_lmk_bary_coords": weights[None]})
    found, numbers = read_embedding(tmp_path / "full.npy", MODEL, 68)
    assert_points(found, faces, weights)
    np.testing.assert_array_equal(numbers, np.arange(68))


@pytest.mark.parametrize("count", [478, 105])
def test_landmark_indices_choose_among_those_of_mediapipe(count, tmp_path):
    """Landmarks that are as many as the embedding's have been chosen before."""
    (faces, weights), chosen = faces_and_weights(105), np.random.default_rng(1).permutation(478)[:105]
    arrays = {"lmk_face_idx": faces, "lmk_b_coords": weights, "landmark_indices": chosen}
    np.savez(tmp_path / "mediapipe.npz", **arrays)
    found, numbers = read_embedding(tmp_path / "mediapipe.npz", MODEL, count)
    assert_points(found, faces, weights)
    np.testing.assert_array_equal(numbers, chosen if count == 478 else np.arange(105))


def test_vertices_and_faces_of_ones_own(tmp_path):
    np.savez(tmp_path / "a.npz", vertices=np.array([3, 1, 4]))
    found, numbers = read_embedding(tmp_path / "a.npz", MODEL, 3)
    np.testing.assert_array_equal(found.interpolate(MODEL.v_template), MODEL.v_template[[3, 1, 4]])
    np.testing.assert_array_equal(numbers, [0, 1, 2])
    faces, weights = faces_and_weights(3)
    np.savez(tmp_path / "b.npz", faces=faces, barycentric=weights)
    assert_points(read_embedding(tmp_path / "b.npz", MODEL, 3)[0], faces, weights)


THREE = np.tile([0.2, 0.3, 0.5], (3, 1))


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"vertices": np.array([3, 1])}, "2 points for 3 landmarks"),
        ({"vertices": np.array([3, 1, 10**6])}, "vertices: indices must lie in"),
        ({"faces": np.array([3, 1, 2])}, "barycentric: this array is missing"),
        ({"faces": np.array([3, 1, 2]), "barycentric": THREE[:2]}, r"barycentric: shape \(2, 3\), expected 3 x 3"),
        ({"faces": np.array([3, 1, 2]), "barycentric": THREE + 0.1}, "point 0 add up to 1.3"),
        ({"lmk_face_idx": np.full(3, 10**5), "lmk_b_coords": THREE}, "lmk_face_idx: indices must lie in"),
        ({"lmk_face_idx": np.zeros((79, 17), int), "lmk_b_coords": np.ones((79, 17, 3))}, "lmk_face_idx: shape"),
        (
            {"lmk_face_idx": np.arange(2), "lmk_b_coords": THREE[:2], "landmark_indices": np.array([1, 3])},
            "landmark_indices: indices must lie in 0..2",
        ),
        (
            {"lmk_face_idx": np.arange(2), "lmk_b_coords": THREE[:2], "landmark_indices": np.array([1, 1])},
            "landmark_indices: a number appears twice",
        ),
        ({"landmarks": np.arange(3)}, "holds none of vertices, faces, lmk_face_idx"),
    ],
)
def test_embeddings_that_do_not_fit_are_refused(tmp_path, arrays, message):
    np.savez(tmp_path / "embedding.npz", **arrays)
    with pytest.raises(InputError, match=message):
        read_embedding(tmp_path / "embedding.npz", MODEL, 3)


def test_other_kinds_of_files_are_refused(tmp_path):
    with pytest.raises(InputError, match="an embedding is a file of the kinds"):
        read_embedding(tmp_path / "embedding.txt", MODEL, 3)
    with pytest.raises(InputError, match=r"a\.pkl: no such landmark embedding"):
        read_embedding(tmp_path / "a.pkl", MODEL, 3)


def test_without_a_file_the_landmarks_are_the_models_own():
    with pytest.raises(InputError, match=r"has none of its own: give --embedding FILE"):
        read_embedding(None, MODEL, 68)
    own = SurfacePoints.at_vertices(np.arange(68))
    found, numbers = read_embedding(None, replace(MODEL, landmarks68=own), 68)
    assert found is own
    np.testing.assert_array_equal(numbers, np.arange(68))
    with pytest.raises(InputError, match="70 landmarks; the head model has 68 of its own"):
        read_embedding(None, replace(MODEL, landmarks68=own), 70)


def test_landmarks_of_mediapipe_need_a_face():
    """The small head has no mouth."""
    with pytest.raises(InputError, match=r"MediaPipe's landmarks find no place on it: .*remedy: give --embedding FILE"):
        read_embedding(None, MODEL, 478)
