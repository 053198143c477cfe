"""Landmarks on head models: found again, symmetric, on lids, lips and eyeballs, the same in every unit."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from heads import gnm_file
from shared_data import DATA, needs_data
from small_head import small_head

from carigs.cli.main import main
from carigs.detection.mesh_indices import FACE_OUTLINE, LEFT_EYE, LEFT_IRIS, LIPS_INNER, MIRRORED, RIGHT_EYE, RIGHT_IRIS
from carigs.embedding import REGISTRATION, LandmarkEmbedding, landmark_embedding, register_landmarks
from carigs.embedding.canonical_face import canonical_face
from carigs.errors import MeshError
from carigs.fitting.landmarks.embedding import read_embedding
from carigs.head import HeadModel, HeadParameters, flame_joints, pose
from carigs.readers.npz import read_npz
from carigs.toy.rig.head_model import head_model

CENTIMETRE = 0.01


def places(embedding: LandmarkEmbedding, model: HeadModel, vertices: np.ndarray | None = None) -> np.ndarray:
    """Landmarks (478, 3) in metres; NaN where they have no place."""
    found = np.full((478, 3), np.nan)
    on = model.v_template if vertices is None else vertices
    found[embedding.landmarks] = embedding.points(model).interpolate(on.astype(np.float64))
    return found


@pytest.fixture(scope="module")
def toy():
    model = head_model()
    return model, register_landmarks(model)


def bare_head(vertices: np.ndarray, faces: np.ndarray, eyes: np.ndarray) -> HeadModel:
    """A head of skin alone, whose joints are at given places."""
    v = len(vertices)
    regressor = np.zeros((5, v))
    for row, joint in enumerate([[0, 0, 0], [0, 0, 0], [0, 0, 0], *eyes]):
        system = np.vstack([vertices.T, np.ones(v)])
        regressor[row] = np.linalg.lstsq(system, np.append(joint, 1), rcond=None)[0]
    return HeadModel(
        v_template=vertices.astype(np.float32),
        faces=faces.astype(np.int32),
        shapedirs=np.zeros((v, 3, 2), np.float32),
        posedirs=np.zeros((v, 3, 0), np.float32),
        joint_regressor=regressor.astype(np.float32),
        weights=np.tile(np.float32([1, 0, 0, 0, 0]), (v, 1)),
        parents=np.array([-1, 0, 1, 1, 1]),
        num_identity=1,
    )


def test_a_deformed_canonical_face_is_found_again():
    """Another person's proportions, vertices in another order, another pose of the axes' origin."""
    random, face = np.random.default_rng(3), canonical_face()
    person = face.vertices * [1.06, 0.94, 1.08]
    person += 0.25 * np.sin(0.35 * person @ random.normal(size=(3, 3))) * [0, 1, 1] + [0, 30, -10]
    order = random.permutation(468)
    vertices, faces = CENTIMETRE * person[np.argsort(order)], order[face.faces]
    middles = person[[263, 362, 33, 133]].reshape(2, 2, 3).mean(axis=1)
    model = bare_head(vertices, faces, CENTIMETRE * (middles - [0, 0, 1.2]))
    embedding = register_landmarks(model)
    error = np.linalg.norm(places(embedding, model)[:468] - CENTIMETRE * person, axis=1)
    assert len(embedding.landmarks) > 440 and set(embedding.landmarks) < set(range(468))
    assert np.nanmedian(error) < 1.5e-3 and np.nanpercentile(error, 95) < 5e-3


def test_the_face_is_symmetric_and_left_stays_left(toy):
    found = places(toy[1], toy[0])
    mirrored = found[list(MIRRORED)] * [-1, 1, 1]
    assert np.nanmedian(np.linalg.norm(found - mirrored, axis=1)) < 1e-3
    assert np.nanmax(found[[*LEFT_EYE, *LEFT_IRIS], 0]) < -0.01  # at the left of an image: the subject's right
    assert np.nanmin(found[[*RIGHT_EYE, *RIGHT_IRIS], 0]) > 0.01


def test_nearly_all_landmarks_have_a_place(toy):
    assert len(toy[1].landmarks) >= 460
    assert np.isin(FACE_OUTLINE, toy[1].landmarks).all()
    assert np.isin([*LEFT_IRIS, *RIGHT_IRIS], toy[1].landmarks).all()
    np.testing.assert_array_equal(np.sort(np.concatenate([toy[1].landmarks, toy[1].missing])), np.arange(478))
    assert (toy[1].barycentric >= 0).all()
    np.testing.assert_allclose(toy[1].barycentric.sum(axis=1), 1)


def test_lips_open_with_the_jaw(toy):
    """Upper and lower lip meet, and lie on different lips of the head."""
    model, embedding = toy
    closed = places(embedding, model)
    opened = places(embedding, model, pose(model, HeadParameters(joints=flame_joints(jaw=[0.25, 0, 0]))))
    upper, lower = (13, 82, 312), (14, 87, 317)
    assert np.linalg.norm(closed[list(upper)] - closed[list(lower)], axis=1).max() < 4e-3
    moved = np.linalg.norm(opened - closed, axis=1)
    assert moved[list(upper)].max() < 2e-3 and moved[list(lower)].min() > 8e-3


def test_lids_lie_around_the_eyeballs_and_irises_on_them(toy):
    model, embedding = toy
    found = places(embedding, model)
    for side, lids, iris in (("left", RIGHT_EYE, RIGHT_IRIS), ("right", LEFT_EYE, LEFT_IRIS)):
        centre = model.joint_template[model.joint_names.index(f"{side}_eye")]
        ball = model.v_template[model.regions[f"{side}_eyeball"]]
        radius = np.linalg.norm(ball - centre, axis=1).max()
        distance = np.linalg.norm(found[list(lids)] - centre, axis=1) / radius
        assert 0.9 < np.nanmin(distance) and np.nanmax(distance) < 1.7
        np.testing.assert_allclose(found[iris[0], :2], centre[:2], atol=1e-4)
        right, upper, left, lower = found[list(iris[1:])] - centre
        assert right[0] > 4e-3 > -4e-3 > left[0] and upper[1] > 4e-3 > -4e-3 > lower[1]
        turned = HeadParameters(joints=flame_joints(**{f"{side}_eye": [0, 0.3, 0]}))
        moved = np.linalg.norm(places(embedding, model, pose(model, turned)) - found, axis=1)
        assert set(np.flatnonzero(moved > 1e-6)) == set(iris)


@pytest.mark.parametrize("scale", [100.0, 1e-3])
def test_the_unit_does_not_matter(scale, toy):
    model, embedding = toy
    other = register_landmarks(replace(model, v_template=np.float32(scale) * model.v_template))
    np.testing.assert_array_equal(other.landmarks, embedding.landmarks)
    np.testing.assert_allclose(places(other, model), places(embedding, model), atol=1e-4)


def test_a_head_without_landmarks_of_its_own(toy, tmp_path):
    """A file in the layout of GNM, whose joints and vertex groups are other ones: eyes and mouth are found by shape."""
    model, embedding = toy
    bound = np.stack([model.weights[:, [0, 1, 2]].sum(axis=1), 0 * model.weights[:, 0], *model.weights.T[3:]])
    v = len(model.v_template)
    joints = model.joint_template[[0, 1, 3, 4]].astype(np.float32)
    arrays = {
        "template_vertex_positions": model.v_template,
        "template_joint_positions": joints,
        "vertex_identity_basis": np.zeros((1, v, 3), np.float32),
        "joint_identity_basis": np.zeros((1, 4, 3), np.float32),
        "expression_basis": np.zeros((1, v, 3), np.float32),
        "expression_names": np.array(["smile"]),
        "joint_names": np.array(["neck", "head", "left_eye", "right_eye"]),
        "joint_parent_indices": np.array([0, 0, 1, 1]),
        "skinning_weights": bound.astype(np.float32),
        "triangles": model.faces,
        "joint_regressor": model.joint_regressor[[0, 1, 3, 4]],
    }
    other = HeadModel.load(gnm_file(tmp_path, arrays))
    assert other.landmarks68 is None and not other.regions
    found = places(register_landmarks(other), other)
    distance = np.linalg.norm(found - places(embedding, model), axis=1)
    assert np.nanmedian(distance) < 1e-3
    for contour in (LIPS_INNER, LEFT_EYE, RIGHT_EYE, LEFT_IRIS, RIGHT_IRIS):
        assert np.nanmax(distance[list(contour)]) < 1e-3


def test_known_heads_need_no_registration(toy):
    shipped = landmark_embedding(toy[0])
    assert shipped.source == "toy.npz"
    distance = np.linalg.norm(places(shipped, toy[0]) - places(toy[1], toy[0]), axis=1)
    assert np.nanmedian(distance) < 1e-4 and np.nanpercentile(distance, 99) < 1e-3
    person = replace(toy[0], v_template=np.float32([1.1, 1, 1]) * toy[0].v_template)
    assert landmark_embedding(person).source == "toy.npz"  # triangles, not shapes, are known
    mirrored = replace(toy[0], faces=toy[0].faces[::-1].copy())
    assert landmark_embedding(mirrored).source == REGISTRATION


def test_a_fit_to_478_landmarks_needs_no_file(toy):
    points, numbers = read_embedding(None, toy[0], 478)
    shipped = landmark_embedding(toy[0])
    np.testing.assert_array_equal(numbers, shipped.landmarks)
    np.testing.assert_array_equal(points.corners, shipped.points(toy[0]).corners)


def test_the_command_writes_what_a_fit_reads(toy, tmp_path, capsys):
    model = tmp_path / "head.npz"
    toy[0].save(model)
    assert main(["head", "embed", str(model)]) == 0
    file = tmp_path / "head_mediapipe.npz"
    left_out = ", ".join(map(str, landmark_embedding(toy[0]).missing))
    says = (
        f"{len(landmark_embedding(toy[0]).landmarks)} of 478 landmarks, from carigs' file toy.npz; left out: {left_out}"
    )
    assert capsys.readouterr().out == f"{file}  {says}\n"
    assert set(read_npz(file)) == {"lmk_face_idx", "lmk_b_coords", "landmark_indices"}
    points, numbers = read_embedding(file, toy[0], 478)
    expected, expected_numbers = read_embedding(None, toy[0], 478)
    np.testing.assert_array_equal(numbers, expected_numbers)
    np.testing.assert_allclose(points.interpolate(toy[0].v_template), expected.interpolate(toy[0].v_template))


def turned(rotation: np.ndarray) -> HeadModel:
    """The procedural head in other axes, with its triangles in another order: it is not known."""
    model = head_model()
    vertices = (model.v_template @ rotation.T).astype(np.float32)
    return replace(model, v_template=vertices, faces=model.faces[::-1].copy(), landmarks68=None)


WRONG = {
    "it looks to -z": (lambda: turned(np.diag([-1.0, 1, -1])), "the left eye is not at"),
    "z is up": (lambda: turned(np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]])), "looks to .z"),
    "a ball": (lambda: replace(small_head(), joint_regressor=np.roll(small_head().joint_regressor, 1, 0)), "eye"),
    "no eyes": (
        lambda: replace(small_head(), joint_names=("root", "neck", "jaw", "a", "b")),
        "no joints left_eye and right_eye, no eyeballs and no landmarks68",
    ),
}


@pytest.mark.parametrize("case", WRONG)
def test_what_is_no_face_is_refused_in_one_line(case, tmp_path, capsys):
    make, says = WRONG[case]
    model = make()
    with pytest.raises(MeshError, match=says):
        register_landmarks(model)
    file = tmp_path / "head.npz"
    model.save(file)
    assert main(["head", "embed", str(file)]) == 1
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and lines[0].startswith(f"carigs: {file}: ")
    assert {path.name for path in tmp_path.iterdir()} == {"head.npz"}


@pytest.mark.slow
@needs_data
def test_ict_agrees_with_landmarks_that_were_detected_in_images_of_it():
    model = HeadModel.load(DATA / "ict_model.npz")
    measured, numbers = read_embedding(DATA / "real" / "ict_mediapipe_embedding.npz", model, 478)
    for known, bar in ((model, 2.0e-3), (replace(model, landmarks68=None), 2.2e-3)):
        found = places(register_landmarks(known), known)[numbers]
        error = np.linalg.norm(found - measured.interpolate(model.v_template), axis=1)
        assert np.isfinite(error).mean() > 0.98 and np.nanmedian(error) <= bar
    shipped = landmark_embedding(model)
    assert shipped.source == "ict_facekit.npz"
    assert (
        np.nanmedian(np.linalg.norm(places(shipped, model)[numbers] - measured.interpolate(model.v_template), axis=1))
        <= 2e-3
    )
