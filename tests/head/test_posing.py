"""Posing: rigid invariance, the kinematic chain, and file round trips."""

import pickle
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from heads import random_model
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csc_matrix
from scipy.spatial.transform import Rotation

from carigs.errors import InputError
from carigs.exaggeration import Caricature
from carigs.head import HeadModel, HeadParameters, flame_joints, neutral, pose
from carigs.head.joint_transforms import rotation_matrices
from carigs.head.posing import active_blendshapes, unposed_frames

vector = st.tuples(*[st.floats(-3, 3)] * 3).map(np.array)


def random_parameters(seed: int, v: int = 30) -> HeadParameters:
    random = np.random.default_rng(seed)
    return HeadParameters(
        *(random.normal(size=n) for n in (3, 3, (4, 3), 300, 100)), static_offset=0.01 * random.normal(size=(v, 3))
    )


@given(vector)
def test_rodrigues_agrees_with_scipy(rotation_vector):
    expected = Rotation.from_rotvec(rotation_vector).as_matrix()
    np.testing.assert_allclose(rotation_matrices(rotation_vector), expected, atol=1e-12)


def test_rest_pose_is_the_neutral():
    model = random_model()
    parameters = HeadParameters(shape=np.random.default_rng(1).normal(size=300))
    np.testing.assert_allclose(pose(model, parameters), neutral(model, parameters), atol=1e-12)


def test_head_rotation_is_rigid_about_the_root_joint():
    model, parameters = random_model(), random_parameters(2)
    still = HeadParameters(**{**vars(parameters), "rotation": np.zeros(3), "translation": np.zeros(3)})
    before, after = pose(model, still), pose(model, parameters)
    shaped = neutral(model, parameters) + model.shapedirs[:, :, 300:].astype(float) @ parameters.expression
    root = model.joint_regressor[0].astype(float) @ shaped
    rotation = rotation_matrices(parameters.rotation)
    np.testing.assert_allclose(after, (before - root) @ rotation.T + root + parameters.translation, atol=1e-6)


def test_the_jaw_moves_only_the_vertices_with_its_weight():
    model = random_model()
    model = replace(model, posedirs=np.zeros_like(model.posedirs))
    open_mouth = HeadParameters(joints=flame_joints(jaw=[0.3, 0, 0]))
    moved = np.linalg.norm(pose(model, open_mouth) - pose(model, HeadParameters()), axis=1) > 1e-9
    assert np.array_equal(moved, model.weights[:, 2] > 0)


def test_displacement_is_a_change_of_the_neutral():
    """An offset given as displacement or as static offset poses the same."""
    model, parameters = random_model(), random_parameters(3)
    offset = np.random.default_rng(4).normal(size=(30, 3))
    as_static = HeadParameters(**{**vars(parameters), "static_offset": parameters.static_offset + offset})
    np.testing.assert_allclose(pose(model, parameters, Caricature(offset)), pose(model, as_static), atol=1e-12)


def test_changed_blendshapes_are_those_of_a_changed_model():
    """Changes of expressions and pose correctives pose as a model with these changes in its blendshapes."""
    model, parameters = random_model(), random_parameters(5)
    changes = 0.1 * np.random.default_rng(6).normal(size=(5, 30, 3)).astype(np.float32)
    columns = np.array([0, 7, 99, 100, 135])  # three expressions, the first and the last corrective
    directions = np.concatenate([model.shapedirs[:, :, 300:], model.posedirs], axis=2)
    directions[:, :, columns] += changes.transpose(1, 2, 0)
    shapedirs = np.concatenate([model.shapedirs[:, :, :300], directions[:, :, :100]], axis=2)
    changed = replace(model, shapedirs=shapedirs, posedirs=directions[:, :, 100:])
    caricature = Caricature(np.zeros((30, 3)), columns, changes)
    np.testing.assert_allclose(pose(model, parameters, caricature), pose(changed, parameters), atol=1e-6)


def test_active_blendshapes_are_those_with_a_coefficient():
    model = random_model()
    model.shapedirs[:, :, 305] = 0  # a blendshape without effect
    first, second = np.zeros(100), np.zeros(100)
    first[[3, 5]], second[7] = 1.0, -0.5
    blendshapes, columns = active_blendshapes(
        model, [HeadParameters(expression=first), HeadParameters(expression=second)]
    )
    np.testing.assert_array_equal(columns, [3, 7])
    np.testing.assert_array_equal(blendshapes, model.shapedirs[:, :, [303, 307]].transpose(2, 0, 1))
    _, columns = active_blendshapes(model, [HeadParameters(joints=flame_joints(jaw=[0.2, 0, 0]))])
    np.testing.assert_array_equal(columns, 100 + 9 + np.array([4, 5, 7, 8]))  # the entries of a rotation about x


def test_model_round_trip(tmp_path):
    model = random_model()
    model.save(tmp_path / "model.npz")
    again = HeadModel.load(tmp_path / "model.npz")
    for name in ("v_template", "faces", "shapedirs", "posedirs", "joint_regressor", "weights", "parents"):
        np.testing.assert_array_equal(getattr(again, name), getattr(model, name))
    assert again.expression_names == ("jawOpen",)
    np.testing.assert_array_equal(again.face_region("nose", "lips"), model.face_region("nose", "lips"))


def test_flame_pickle_is_read_without_chumpy(tmp_path):
    model = random_model()
    content = {
        "v_template": model.v_template,
        "f": model.faces.astype(np.uint32),
        "shapedirs": model.shapedirs,
        "posedirs": model.posedirs,
        "J_regressor": csc_matrix(model.joint_regressor),
        "weights": model.weights,
        "kintree_table": np.array([[4294967295, 0, 1, 1, 1], [0, 1, 2, 3, 4]]),
    }
    (tmp_path / "flame.pkl").write_bytes(pickle.dumps(content))
    (tmp_path / "FLAME_masks.pkl").write_bytes(pickle.dumps({"nose": np.array([1, 2])}))
    again = HeadModel.load(tmp_path / "flame.pkl")
    np.testing.assert_array_equal(again.joint_regressor, model.joint_regressor)
    np.testing.assert_array_equal(again.regions["nose"], [1, 2])
    assert again.parents[0] == -1


def test_pickles_run_no_code(tmp_path):
    (tmp_path / "evil.pkl").write_bytes(b"cos\nsystem\n(S'true'\ntR.")
    with pytest.raises(InputError, match="refuses to load"):
        HeadModel.load(tmp_path / "evil.pkl")


def test_parameters_round_trip(tmp_path):
    model, parameters = random_model(), random_parameters(5)
    parameters.save(tmp_path / "00000.npz", model)
    again = HeadParameters.load(tmp_path / "00000.npz", model)
    for name, value in vars(parameters).items():
        if value is not None:
            np.testing.assert_allclose(getattr(again, name), value, rtol=1e-6)


@pytest.mark.parametrize("name", ["model.npz", "00000.npz"])
def test_small_files_of_large_arrays_are_refused_before_they_are_read(name, tmp_path):
    """The directory of the zip file claims 2 GB for every array, as that of a file of zeros can in truth."""
    model = random_model()
    model.save(tmp_path / "model.npz")
    random_parameters(6).save(tmp_path / "00000.npz", model)
    content = (tmp_path / name).read_bytes()
    head, *entries = content.split(b"PK\x01\x02")
    claims = [entry[:20] + (2**31 - 1).to_bytes(4, "little") + entry[24:] for entry in entries]
    (tmp_path / name).write_bytes(b"PK\x01\x02".join([head, *claims]))
    tracemalloc.start()
    with pytest.raises(InputError, match=f"{name}: .* bytes of arrays; at most"):
        HeadModel.load(tmp_path / name) if name == "model.npz" else HeadParameters.load(tmp_path / name, model)
    assert tracemalloc.get_traced_memory()[1] < 10e6
    tracemalloc.stop()


def broken(arrays: dict, key: str, value) -> dict:
    return {k: v for k, v in {**arrays, key: value}.items() if v is not None}


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("weights", None, "weights: this array is missing"),
        ("weights", np.zeros((7, 5)), r"weights: shape \(7, 5\), expected 30 x 5"),
        ("v_template", np.full((30, 3), np.nan), r"v_template: not a finite number at \(0, 0\)"),
        ("f", np.full((4, 3), 30), "f: indices must lie in"),
        ("mask_nose", np.array([99]), "mask_nose: indices must lie in"),
    ],
)
def test_broken_models_are_named(tmp_path, key, value, says):
    random_model().save(tmp_path / "model.npz")
    with np.load(tmp_path / "model.npz") as archive:
        np.savez(tmp_path / "broken.npz", **broken(dict(archive), key, value))
    with pytest.raises(InputError, match=f"broken.npz: {says}"):
        HeadModel.load(tmp_path / "broken.npz")


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("jaw_pose", None, "jaw_pose: this array is missing"),
        ("expr", np.zeros((1, 101)), "expr: 101 values, expected 100"),
        ("rotation", np.array([[0, np.inf, 0]]), r"rotation: not a finite number at \(0, 1\)"),
        ("static_offset", np.zeros((1, 29, 3)), "static_offset: shape"),
        ("static_offset", np.full((1, 30, 3), np.nan), r"static_offset: not a finite number at \(0, 0, 0\)"),
    ],
)
def test_broken_parameters_are_named(tmp_path, key, value, says):
    model = random_model()
    random_parameters(6).save(tmp_path / "00000.npz", model)
    with np.load(tmp_path / "00000.npz") as archive:
        np.savez(tmp_path / "00001.npz", **broken(dict(archive), key, value))
    with pytest.raises(InputError, match=f"00001.npz: {says}"):
        HeadParameters.load(tmp_path / "00001.npz", model)


def test_a_head_whose_joints_do_not_turn_is_posed_as_it_is_before():
    """It is only moved; and the joints of a turned head are those before they turn."""
    model, parameters = random_model(), random_parameters(3)
    still = replace(parameters, rotation=np.zeros(3), joints=np.zeros((4, 3)))
    caricature = Caricature(0.01 * np.random.default_rng(4).normal(size=(30, 3)))
    vertices, joints, rotations = unposed_frames(model, [still, parameters], caricature)
    np.testing.assert_allclose(pose(model, still, caricature), vertices[0] + still.translation, atol=1e-6)
    np.testing.assert_allclose(joints[0], joints[1], atol=1e-12)
    np.testing.assert_allclose(rotations[0], np.tile(np.eye(3), (5, 1, 1)), atol=1e-12)
    np.testing.assert_allclose(rotations[1, 0], rotation_matrices(parameters.rotation), atol=1e-12)
