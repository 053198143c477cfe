"""FLAME's and GNM's forward models: equal to their published equations, written with loops and 4x4 matrices."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from heads import gnm_file, gnm_like, random_model
from scipy.spatial.transform import Rotation

from carigs.errors import InputError, MeshError
from carigs.exaggeration import Caricature
from carigs.head import HeadModel, HeadParameters, neutral, pose, pose_frames, subject_model
from carigs.toy.rig.head_model import head_model


def random_parameters(model: HeadModel, seed: int, *, offsets: bool = True) -> HeadParameters:
    random, v = np.random.default_rng(seed), model.v_template.shape
    zeros = HeadParameters.zeros(model)
    values = {name: random.normal(size=getattr(zeros, name).shape) for name in ("joints", "shape", "expression")}
    if offsets:
        values |= {"static_offset": 0.1 * random.normal(size=v), "dynamic_offset": 0.1 * random.normal(size=v)}
    return HeadParameters(random.normal(size=3), random.normal(size=3), **values)


def skinned(vertices, joints, rotations, parents, weights) -> np.ndarray:
    """Linear blend skinning, one vertex and joint at a time: G_j = prod over ancestors of [R | position - parent]."""
    world = []
    for j, parent in enumerate(parents):
        local = np.eye(4)
        local[:3, :3] = rotations[j]
        local[:3, 3] = joints[j] - (joints[parent] if j else 0)
        world.append(world[parent] @ local if j else local)
    result = np.zeros_like(vertices)
    for i, vertex in enumerate(vertices):
        for j, transform in enumerate(world):
            result[i] += weights[i, j] * (transform[:3, :3] @ (vertex - joints[j]) + transform[:3, 3])
    return result


def flame(model: HeadModel, p: HeadParameters) -> np.ndarray:
    """Li et al. 2017, equations 1 to 5, with the offsets of VHAP; FLAME's 5 joints and 300 identities."""
    v = model.v_template.astype(float)
    for i in range(300):
        v = v + p.shape[i] * model.shapedirs[:, :, i].astype(float)
    for e, value in enumerate(p.expression):
        v = v + value * model.shapedirs[:, :, 300 + e].astype(float)
    v = v + p.static_offset + p.dynamic_offset
    joints = np.array([row.astype(float) @ v for row in model.joint_regressor])
    rotations = Rotation.from_rotvec(np.vstack([p.rotation, p.joints])).as_matrix()
    feature = np.concatenate([(rotation - np.eye(3)).ravel() for rotation in rotations[1:]])
    v = v + sum(value * model.posedirs[:, :, k].astype(float) for k, value in enumerate(feature))
    return skinned(v, joints, rotations, [-1, 0, 1, 1, 1], model.weights.astype(float)) + p.translation


def gnm(arrays: dict[str, np.ndarray], p: HeadParameters) -> np.ndarray:
    """GNM's formal definition, on the arrays of its file."""
    a = {name: value.astype(float) for name, value in arrays.items() if value.dtype.kind == "f"}
    v = a["template_vertex_positions"] + np.einsum("i,ivx->vx", p.shape, a["vertex_identity_basis"])
    v = v + np.einsum("e,evx->vx", p.expression, a["expression_basis"])
    joints = a["template_joint_positions"] + np.einsum("i,ijx->jx", p.shape, a["joint_identity_basis"])
    rotations = Rotation.from_rotvec(np.vstack([p.rotation, p.joints])).as_matrix()
    feature = np.concatenate([(rotation - np.eye(3)).ravel() for rotation in rotations])
    v = v + (feature @ a["pose_correctives_regressor"]).reshape(-1, 3)
    return skinned(v, joints, rotations, arrays["joint_parent_indices"], a["skinning_weights"].T) + p.translation


@pytest.mark.parametrize("seed", range(3))
def test_flame_is_posed_by_its_equations(seed):
    model = random_model(seed)
    parameters = random_parameters(model, seed)
    np.testing.assert_allclose(pose(model, parameters), flame(model, parameters), atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_gnm_is_posed_by_its_equations(seed, tmp_path):
    arrays = gnm_like(seed)
    model = HeadModel.load(gnm_file(tmp_path, arrays))
    parameters = random_parameters(model, seed, offsets=False)
    np.testing.assert_allclose(pose(model, parameters), gnm(arrays, parameters), atol=1e-6)


def test_offsets_move_the_joints_of_gnm_by_its_regressor(tmp_path):
    """An offset of all vertices by one vector moves all joints by it, and with them the whole posed head."""
    model = HeadModel.load(gnm_file(tmp_path, gnm_like(0)))
    parameters = random_parameters(model, 1, offsets=False)
    shift = np.array([0.3, -0.2, 0.1])
    moved = pose(model, replace(parameters, static_offset=np.tile(shift, (len(model.v_template), 1))))
    np.testing.assert_allclose(moved, pose(model, parameters) + shift, atol=1e-6)


@pytest.mark.parametrize("name", ["flame", "gnm"])
def test_frames_are_posed_together_as_alone(name, tmp_path):
    """Frames of two subjects, with and without offsets, natural and caricatured."""
    model = random_model() if name == "flame" else HeadModel.load(gnm_file(tmp_path, gnm_like(0)))
    first, second = (random_parameters(model, seed, offsets=seed == 1) for seed in (1, 2))
    frames = [first, second, replace(second, shape=first.shape)]
    random, v = np.random.default_rng(0), model.v_template.shape
    columns = np.array([0, model.num_expressions])
    for caricature in (None, Caricature(random.normal(size=v), columns, random.normal(size=(2, *v)))):
        together = pose_frames(model, frames, caricature)
        for posed, frame in zip(together, frames, strict=True):
            np.testing.assert_allclose(posed, pose(model, frame, caricature), atol=1e-12)


@pytest.mark.parametrize("name", ["flame", "gnm"])
def test_the_model_of_a_subject_poses_as_the_general_one(name, tmp_path):
    model = random_model() if name == "flame" else HeadModel.load(gnm_file(tmp_path, gnm_like(0)))
    parameters = random_parameters(model, 3)
    subject = subject_model(model, parameters)
    np.testing.assert_allclose(subject.v_template, neutral(model, parameters), rtol=1e-6, atol=1e-6)
    general = replace(parameters, static_offset=None, shape=np.zeros(model.num_identity))
    other = replace(general, shape=np.ones(model.num_identity))
    np.testing.assert_allclose(pose(subject, general), pose(model, parameters), atol=2e-5)
    np.testing.assert_array_equal(pose(subject, other), pose(subject, general))


def test_parameters_of_another_model_are_refused(tmp_path):
    model = HeadModel.load(gnm_file(tmp_path, gnm_like(0)))
    with pytest.raises(MeshError, match=r"joints has the shape \(4, 3\), the head model needs \(3, 3\)"):
        pose(model, HeadParameters())


# Files.


def test_gnm_is_read_with_its_layout(tmp_path):
    arrays = gnm_like(0)
    model = HeadModel.load(gnm_file(tmp_path, arrays))
    assert (model.num_identity, model.num_expressions, len(model.parents)) == (6, 5, 4)
    assert model.joint_names == ("neck", "head", "left_eye", "right_eye")
    np.testing.assert_array_equal(model.parents, [-1, 0, 1, 1])
    assert model.expression_names == tuple(arrays["expression_names"])
    np.testing.assert_array_equal(model.faces, arrays["triangles"])
    np.testing.assert_array_equal(model.regions["left_ear"], [0])  # ears and left
    np.testing.assert_array_equal(model.regions["lips"], [2, 3])  # either lip, with a weight of a half or more
    np.testing.assert_array_equal(model.regions["left_eyeball"], [4])


def test_gnm_gets_the_regions_that_it_lacks_by_geometry(tmp_path):
    """On the points of the procedural head: groups of the file are kept, the scalp is found."""
    toy = head_model()
    arrays = gnm_like(0, len(toy.v_template)) | {"template_vertex_positions": toy.v_template, "triangles": toy.faces}
    sides = {"left_eye": "left_eyeball", "right_eye": "right_eyeball", "upper_lip": "lips", "lower_lip": "lips"}
    groups = {group: toy.vertex_region(region) for group, region in sides.items()}
    groups["skin_exterior"] = ~(groups["left_eye"] | groups["right_eye"] | toy.vertex_region("lip_inside"))
    arrays |= {
        "vertex_group_names": np.array(list(groups)),
        "vertex_groups": np.array(list(groups.values()), np.float32),
    }
    model = HeadModel.load(gnm_file(tmp_path, arrays))
    np.testing.assert_array_equal(model.regions["lips"], toy.regions["lips"])
    found, expected = model.vertex_region("scalp"), toy.vertex_region("scalp")
    assert (found & expected).sum() > 0.85 * max(found.sum(), expected.sum())
    assert {"neck", "boundary", "left_ear", "left_eyelid"} <= set(model.regions)


def test_quads_are_split_as_gnm_splits_them(tmp_path):
    arrays = gnm_like(0)
    triangles = arrays.pop("triangles")
    np.testing.assert_array_equal(HeadModel.load(gnm_file(tmp_path, arrays)).faces, triangles)


def test_a_quad_that_names_a_corner_twice_is_one_triangle(tmp_path):
    arrays = gnm_like(0)
    del arrays["triangles"]
    arrays["quads"][0, 3] = arrays["quads"][0, 2]
    faces = HeadModel.load(gnm_file(tmp_path, arrays)).faces
    assert len(faces) == 2 * len(arrays["quads"]) - 1
    np.testing.assert_array_equal(faces[0], arrays["quads"][0, :3])


def test_gnm_without_correctives_or_groups_is_read(tmp_path):
    arrays = gnm_like(0)
    for name in ("pose_correctives_regressor", "vertex_groups", "vertex_group_names"):
        del arrays[name]
    model = HeadModel.load(gnm_file(tmp_path, arrays))
    assert model.posedirs.shape[2] == 0
    parameters = random_parameters(model, 0, offsets=False)
    arrays["pose_correctives_regressor"] = np.zeros((36, 3 * len(model.v_template)))
    np.testing.assert_allclose(pose(model, parameters), gnm(arrays, parameters), atol=1e-6)


@pytest.mark.parametrize(
    ("key", "change", "says"),
    [
        ("joint_identity_basis", None, "joint_identity_basis: this array is missing"),
        ("vertex_identity_basis", lambda a: a.transpose(1, 0, 2), r"vertex_identity_basis: shape"),
        ("skinning_weights", lambda a: a.T, "skinning_weights: shape"),
        ("pose_correctives_regressor", lambda a: a.T, "pose_correctives_regressor: shape"),
        ("triangles", lambda a: a + 100, "triangles: indices must lie in"),
        ("vertex_groups", lambda a: a[:-1], "vertex_group_names: shape"),
        ("joint_parent_indices", lambda a: a[::-1], "kintree_table: each joint must come after its parent"),
        ("expression_basis", lambda a: a * np.nan, "expression_basis: not a finite number"),
    ],
)
def test_broken_gnm_files_are_named(key, change, says, tmp_path):
    arrays = gnm_like(0)
    value = arrays.pop(key)
    if change is not None:
        arrays[key] = change(value)
    with pytest.raises(InputError, match=f"gnm_head.npz: {says}"):
        HeadModel.load(gnm_file(tmp_path, arrays))


@pytest.mark.parametrize("joints", [1, 2, 5, 7])
@pytest.mark.parametrize("corrected", [0, 1])
def test_any_head_comes_back_from_its_file(joints, corrected, tmp_path):
    model = random_model(joints=joints, identities=3, expressions=2, corrected=min(corrected, joints))
    model.save(tmp_path / "model.npz")
    again = HeadModel.load(tmp_path / "model.npz")
    assert again.joint_names == model.joint_names and again.num_identity == 3
    parameters = random_parameters(model, 0)
    parameters.save(tmp_path / "00000.npz", model)
    read = HeadParameters.load(tmp_path / "00000.npz", again)
    np.testing.assert_allclose(pose(again, read), pose(model, parameters), atol=1e-5)


def test_models_with_their_own_joints_come_back(tmp_path):
    model = HeadModel.load(gnm_file(tmp_path, gnm_like(0)))
    model.save(tmp_path / "model.npz")
    again, parameters = HeadModel.load(tmp_path / "model.npz"), random_parameters(model, 0)
    np.testing.assert_array_equal(pose(again, parameters), pose(model, parameters))


@pytest.mark.parametrize(
    ("key", "value", "says"),
    [
        ("num_identity", 5, "shapedirs: 5 columns; 5 identity columns and at least one expression"),
        ("num_identity", -1, "shapedirs: 5 columns; -1 identity columns"),
        ("num_identity", 2.5, "num_identity: holds fractions"),
        ("joint_names", ["a"], "joint_names: shape"),
        ("joint_template", np.zeros((3, 3)), "joint_basis: this array is missing"),
        ("posedirs", np.zeros((12, 3, 8)), "posedirs: 8 columns; 9 for each of at most 3 joints"),
        ("posedirs", np.zeros((12, 3, 36)), "posedirs: 36 columns"),
        ("kintree_table", np.array([[-1, 2, 1], [0, 1, 2]]), "kintree_table: each joint must come after its parent"),
        ("kintree_table", np.array([[-1, 0, 1], [0, 2, 1]]), "kintree_table: its second row must count the joints"),
        ("kintree_table", np.zeros((2, 0)), "kintree_table: 0 joints"),
    ],
)
def test_broken_models_of_other_heads_are_named(key, value, says, tmp_path):
    arrays = random_model(v=12, joints=3, identities=3, expressions=2, corrected=1).arrays()
    np.savez(tmp_path / "model.npz", **{**arrays, key: np.asarray(value)})
    with pytest.raises(InputError, match=f"model.npz: {says}"):
        HeadModel.load(tmp_path / "model.npz")


def test_rotations_of_other_joints_have_one_array(tmp_path):
    model = random_model(joints=3, identities=3, expressions=2)
    random_parameters(model, 0).save(tmp_path / "00000.npz", model)
    with np.load(tmp_path / "00000.npz") as archive:
        arrays = dict(archive)
    assert arrays["joint_rotations"].shape == (2, 3) and "neck_pose" not in arrays
    np.savez(tmp_path / "00001.npz", **{**arrays, "joint_rotations": np.zeros((4, 3))})
    with pytest.raises(InputError, match=r"00001.npz: joint_rotations: 12 values, expected 6"):
        HeadParameters.load(tmp_path / "00001.npz", model)
