"""ICT-FaceKit's folder: the arrays of the model, joints and weights that turn the jaw as its blendshape opens it."""

from __future__ import annotations

import numpy as np
import pytest
from shared_data import DATA, needs_data
from stress.sound_files.facekit import write_facekit

from carigs.cli.main import main
from carigs.errors import InputError
from carigs.head import HeadModel, HeadParameters, flame_joints, pose
from carigs.head.ict_facekit import JAW, VERTICES, read_ict_facekit
from carigs.plausibility.head_models import check_head_model
from carigs.toy.rig.head_model import head_model


@pytest.fixture(scope="module")
def toy_folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("FaceXModel")
    write_facekit(folder, head_model(), 2, {"jawOpen": "jaw_open", "mouthSmile_L": "mouth_smile_left"})
    return folder


@pytest.fixture(scope="module")
def converted(toy_folder, tmp_path_factory):
    file = tmp_path_factory.mktemp("converted") / "ict.npz"
    assert main(["head", "convert-ict", str(toy_folder), "-o", str(file)]) == 0
    return HeadModel.load(file)


def test_the_parts_are_those_of_the_folder(converted):
    toy = head_model()
    assert len(converted.v_template) == 14062 + 2 * 770
    assert (converted.num_identity, converted.expression_names) == (2, ("jawOpen", "mouthSmile_L"))
    np.testing.assert_allclose(
        converted.v_template[14062 : 14062 + 146], toy.v_template[toy.regions["left_eyeball"]], atol=1e-7
    )
    smile = toy.expression_basis[:, :, toy.expression_names.index("mouth_smile_left")]
    np.testing.assert_allclose(
        converted.landmarks68.interpolate(converted.expression_basis)[..., 1],
        toy.landmarks68.interpolate(smile),
        atol=2e-7,
    )
    np.testing.assert_allclose(
        converted.landmarks68.interpolate(converted.v_template), toy.landmarks68.interpolate(toy.v_template), atol=1e-7
    )
    assert len(converted.faces) == len(toy.faces)
    assert {"scalp", "lips", "left_eyelid", "brows", "left_ear", "neck"} <= set(converted.regions)


def test_the_model_can_be_posed(converted, tmp_path):
    assert check_head_model(converted, tmp_path / "ict.npz") == []
    np.testing.assert_allclose(converted.weights.sum(axis=1), 1, atol=1e-6)
    eyes = (converted.joint_template[3] + converted.joint_template[4]) / 2
    unit = np.linalg.norm(converted.joint_template[3] - converted.joint_template[4]) / 2
    np.testing.assert_allclose(converted.joint_template[2], eyes + unit * np.array(JAW), atol=1e-4)
    zeros = HeadParameters.zeros(converted)
    turned = HeadParameters(shape=zeros.shape, expression=zeros.expression, joints=flame_joints(left_eye=[0, 0.3, 0]))
    moved = np.linalg.norm(pose(converted, turned) - pose(converted, zeros), axis=1) > 1e-6
    assert set(np.flatnonzero(moved)) <= set(converted.regions["left_eyeball"])


def jaw_error(model: HeadModel) -> float:
    """Largest distance on the chin between a turn of the jaw and `jawOpen`, as a share of its motion."""
    zeros = HeadParameters.zeros(model)
    column = model.expression_names.index("jawOpen")
    opened = HeadParameters(shape=zeros.shape, expression=np.eye(model.num_expressions)[column])
    chin = model.landmarks68[5:12]
    target = chin.interpolate(pose(model, opened) - pose(model, zeros))
    errors = []
    for angle in np.linspace(0.05, 0.6, 56):
        jaw = HeadParameters(joints=flame_joints(jaw=[angle, 0, 0]), shape=zeros.shape, expression=zeros.expression)
        errors.append(np.linalg.norm(chin.interpolate(pose(model, jaw) - pose(model, zeros)) - target, axis=1).max())
    return min(errors) / np.linalg.norm(target, axis=1).max()


def test_the_jaw_joint_opens_the_mouth_as_the_blendshape_does(converted):
    assert jaw_error(converted) < 0.2


@pytest.mark.slow
@needs_data
def test_the_conversion_agrees_with_the_shared_model(tmp_path):
    """`ict_model.npz` was made from FaceKit by others: same template, faces and blendshapes; weights as it has them."""
    shared = HeadModel.load(DATA / "ict_model.npz")
    write_facekit(tmp_path, shared, 3, {name: name for name in ("jawOpen", "eyeBlink_L")})
    model = read_ict_facekit(tmp_path)
    np.testing.assert_allclose(model.v_template, shared.v_template, atol=1e-7)
    np.testing.assert_array_equal(model.faces, shared.faces)
    np.testing.assert_allclose(model.identity_basis, shared.identity_basis[:, :, :3], atol=2e-7)
    blink = shared.expression_names.index("eyeBlink_L")
    np.testing.assert_allclose(model.expression_basis[:, :, 1], shared.expression_basis[:, :, blink], atol=2e-7)
    np.testing.assert_array_equal(model.landmarks68.corners, shared.landmarks68.corners)
    assert np.corrcoef(model.weights[:14062, 2], shared.weights[:14062, 2])[0, 1] > 0.95
    np.testing.assert_allclose(model.joint_template, shared.joint_template, atol=0.012)
    assert jaw_error(model) < 0.2


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        ("jawOpen.obj", None, "jawOpen.obj: no such mesh of ICT-FaceKit"),
        ("identity001.obj", "v 0 0 0\n", "identity001.obj: 1 vertices, ICT-FaceKit Light has 26719"),
        ("generic_neutral_mesh.obj", "v 0 0\n", "generic_neutral_mesh.obj: line 1: broken line"),
        ("generic_neutral_mesh.obj", "v 1 1 1\n" * VERTICES + "f 1 2 3", "the eyes are not where they are"),
        ("vertex_indices.json", None, "vertex_indices.json: no such"),
        ("vertex_indices.json", "{}", "vertex_indices.json: expressions: this key is missing"),
        ("vertex_indices.json", '{"expressions": ["../jawOpen"]}', "expressions: expected names, among them jawOpen"),
        ("vertex_indices.json", '{"expressions": ["jawOpen", "jawOpen"]}', "expressions: .*, each once"),
        ("vertex_indices.json", '{"expressions": ["jawOpen"]}', "idx_to_landmark_verts: this array is missing"),
    ],
)
def test_broken_folders_are_named(name, change, says, toy_folder, tmp_path):
    for file in toy_folder.iterdir():
        (tmp_path / file.name).symlink_to(file)
    (tmp_path / name).unlink()
    if change is not None:
        (tmp_path / name).write_text(change)
    with pytest.raises(InputError, match=says):
        read_ict_facekit(tmp_path)
