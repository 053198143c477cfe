"""Every array of an avatar is checked when it is loaded: names, shapes, kinds of numbers, finiteness, ranges."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from heads import gnm_file, gnm_like

from carigs.errors import InputError, MeshError
from carigs.exaggeration.gamma_path import straight_path
from carigs.head import HeadModel, HeadParameters, read_subject_path, subject_model
from carigs.light import Shading, fibonacci_sphere, fit_light, light_transfer
from carigs.light.fitting import Observation
from carigs.splat.avatar import Avatar, load_avatar, save_avatar
from carigs.splat.rig.head_sequence import HeadSequence
from carigs.splat.surfels.surfels import flat_discs

BALL = trimesh.creation.icosphere(subdivisions=1, radius=0.1)
VERTICES, FACES = np.asarray(BALL.vertices, np.float32), np.asarray(BALL.faces, np.int32)
V, F, N, T, IDENTITIES, EXPRESSIONS = len(VERTICES), len(FACES), 30, 2, 300, 100


def make_head(weights: float = 1.0) -> HeadModel:
    expressions = np.random.default_rng(0).normal(0, 0.01, (V, 3, EXPRESSIONS))
    return HeadModel(
        v_template=VERTICES,
        faces=FACES,
        shapedirs=np.pad(expressions.astype(np.float32), ((0, 0), (0, 0), (IDENTITIES, 0))),
        posedirs=np.zeros((V, 3, 36), np.float32),
        joint_regressor=np.full((5, V), 1 / V, np.float32),
        weights=np.tile(np.float32([weights, 0, 0, 0, 0]), (V, 1)),
        parents=np.array([-1, 0, 1, 1, 1]),
        regions={"nose": np.array([1, 2])},
        expression_names=("a", "b", "c", "d"),
    )


@pytest.fixture(scope="module")
def arrays(tmp_path_factory):
    rng, file = np.random.default_rng(1), tmp_path_factory.mktemp("avatar") / "a.npz"
    path = straight_path(VERTICES.astype(float), FACES, 0.1 * VERTICES.astype(float), 0.25)
    path = type(path)(
        path.levels, path.displacements, path.faces, path.neutral, {}, np.array([0]), np.zeros((1, 1, V, 3), np.float32)
    )
    parameters = {t: HeadParameters(expression=np.zeros(EXPRESSIONS)) for t in range(T)}
    sequence = HeadSequence(make_head(), parameters, path)
    sequence.shading = Shading(fibonacci_sphere(8), np.ones((9, 3)), 1.0, 2.0, np.zeros(F, bool))
    surfels = flat_discs(
        rng.integers(0, F, N), rng.normal(size=(N, 3)), rng.random(N) + 0.1, 0.6, rng.random((N, 3)), 1
    )
    save_avatar(file, Avatar(surfels, sequence))
    with np.load(file) as archive:
        return dict(archive)


def save(folder, arrays):
    np.savez(folder / "a.npz", **arrays)
    return folder / "a.npz"


def test_the_avatar_is_read(arrays, tmp_path):
    assert len(load_avatar(save(tmp_path, arrays)).surfels) == N


def test_avatars_of_other_heads_come_back(tmp_path):
    """A head with its own joints, and an offset of one timestep."""
    general = HeadModel.load(gnm_file(tmp_path, gnm_like(0)))
    random, v = np.random.default_rng(0), general.v_template.shape
    zeros = HeadParameters.zeros(general)
    head = subject_model(general, replace(zeros, shape=random.normal(size=zeros.shape.shape)))
    posed = replace(
        zeros, rotation=random.normal(size=3), joints=random.normal(size=zeros.joints.shape),
        expression=random.normal(size=zeros.expression.shape),
    )  # fmt: skip
    parameters = {3: posed, 7: replace(posed, dynamic_offset=0.1 * random.normal(size=v))}
    vertices = head.v_template.astype(float)
    sequence = HeadSequence(head, parameters, straight_path(vertices, head.faces, 0.1 * vertices, 0.25))
    surfels = flat_discs(np.zeros(4, int), np.zeros((4, 3)), np.ones(4), 0.6, np.ones((4, 3)), 0)
    save_avatar(tmp_path / "avatar.npz", Avatar(surfels, sequence))
    again = load_avatar(tmp_path / "avatar.npz").sequence
    assert again.head.joint_names == head.joint_names and again.parameters[3].dynamic_offset is None
    for timestep in parameters:
        np.testing.assert_allclose(again.posed(timestep, 0.1), sequence.posed(timestep, 0.1), atol=1e-6)


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"offset_timesteps": np.array([9])}, "offset_timesteps: expected different timesteps of the head"),
        ({"offset_timesteps": np.array([0, 0])}, "offset_timesteps: expected different"),
        ({"offset_dynamic": np.zeros((1, 3, 3))}, "offset_dynamic: shape"),
    ],
)
def test_offsets_of_other_timesteps_or_heads_are_refused(changes, says, arrays, tmp_path):
    count = len(changes.get("offset_timesteps", [0]))
    offsets = {"offset_timesteps": np.array([0]), "offset_dynamic": np.zeros((count, V, 3), np.float32)}
    with pytest.raises(InputError, match=says):
        load_avatar(save(tmp_path, {**arrays, **offsets, **changes}))


OPTIONAL = ("head_expression_names", "head_mask_nose", "path_changes", "path_columns", "shading_light")
SHAPED = (
    "head_v_template head_f head_columns head_blendshapes head_shapedirs head_posedirs head_J_regressor "
    "head_weights head_kintree_table head_mask_nose timesteps pose_translation pose_rotation pose_joints "
    "pose_expression shading_directions shading_light shading_strength shading_limit shading_kept path_levels "
    "path_displacements path_neutral path_columns path_changes surfel_position surfel_rotation surfel_log_scale "
    "surfel_opacity surfel_colour surfel_harmonics surfel_blend surfel_binding background rotate_harmonics"
).split()
CHANGES = {
    "missing": None,
    "one row too many": lambda a: np.concatenate([a, a[-1:]]) if a.ndim else np.stack([a, a]),
    "one column less": lambda a: a[..., :-1] if a.ndim > 1 else a[None],
    "a text": lambda a: np.full(a.shape, "x"),
    "complex": lambda a: a.astype(complex),
    "not a number": lambda a: np.full(a.shape, np.nan),
    "infinite": lambda a: np.full(a.shape, -np.inf),
}
OUT_OF_RANGE = {
    "head_f": [-1, V, 2**31 - 1, 2**32, 0.5],
    "head_columns": [-1, IDENTITIES + EXPRESSIONS],
    "head_blendshapes": [-1, 0, 10**9],
    "head_kintree_table": [3, -2],
    "head_v_template": [1e30, 1e5],
    "head_mask_nose": [-1, V],
    "timesteps": [-1, 0.5],
    "surfel_binding": [-1, F, 2**40],
    "path_columns": [-1, EXPRESSIONS + 36],
    "path_levels": [1e300, 1e-9],
    "path_displacements": [1e300],
    "background": [-0.1, 1.5],
    "rotate_harmonics": [2],
    "shading_light": [-1.0, 1e300],
    "shading_strength": [-1, 2],
    "shading_limit": [0.5, 1e6],
    "shading_directions": [0.0, 5.0],
}


@pytest.mark.parametrize("change", CHANGES)
@pytest.mark.parametrize("name", SHAPED)
def test_a_wrong_array_is_named(name, change, arrays, tmp_path):
    """`surfel_position` of shape (n, 2), for example, was read past its end."""
    changed = dict(arrays)
    if CHANGES[change] is None:
        if name in OPTIONAL:
            pytest.skip("optional")
        del changed[name]
    elif name == "head_mask_nose" and change.startswith("one"):
        pytest.skip("regions have any number of vertices")
    else:
        changed[name] = CHANGES[change](arrays[name])
    with pytest.raises(InputError, match=r"a\.npz: ") as raised:
        load_avatar(save(tmp_path, changed))
    assert "\n" not in str(raised.value)
    if change != "one row too many" and change != "one column less":  # there another array may be the odd one
        assert name in str(raised.value)


@pytest.mark.parametrize(
    ("name", "value"), [(name, value) for name, values in OUT_OF_RANGE.items() for value in values]
)
def test_a_value_out_of_range_is_refused(name, value, arrays, tmp_path):
    """Faces out of range crashed the interpreter."""
    array = arrays[name].copy().astype(np.result_type(arrays[name].dtype, np.array(value).dtype))
    array[(-1,) * array.ndim] = value
    with pytest.raises(InputError, match=name):
        load_avatar(save(tmp_path, {**arrays, name: array}))


def test_a_path_of_another_head_is_refused(tmp_path):
    smaller = trimesh.creation.icosphere(subdivisions=0)
    path = straight_path(np.asarray(smaller.vertices), np.asarray(smaller.faces), np.zeros((12, 3)), 0.25)
    path.save(tmp_path / "path.npz")
    with pytest.raises(InputError, match=r"path\.npz: neutral: .*another head"):
        read_subject_path(tmp_path / "path.npz", make_head())
    turned = straight_path(VERTICES.astype(float), FACES[::-1], np.zeros((V, 3)), 0.25)
    turned.save(tmp_path / "path.npz")
    with pytest.raises(InputError, match=r"path\.npz: faces: "):
        read_subject_path(tmp_path / "path.npz", make_head())


# Numbers that are finite, but too large or too small for what follows.


@pytest.mark.parametrize(
    ("parameters", "weights"),
    [
        (HeadParameters(translation=np.array([1e30, 0, 0]), expression=np.zeros(EXPRESSIONS)), 1.0),
        (HeadParameters(expression=np.full(EXPRESSIONS, 1e200)), 1.0),
        (HeadParameters(expression=np.full(EXPRESSIONS, 1e30)), 1e30),
    ],
)
def test_a_head_that_is_posed_far_away_is_refused(parameters, weights):
    from carigs.head import pose

    with pytest.raises(MeshError, match=r"vertex \d+ of the posed head"):
        pose(make_head(weights), parameters)


def test_a_head_without_extent_cannot_be_lit():
    """With skinning weights of zero all vertices lie at the origin; the shadow map was read past its end."""
    with pytest.raises(MeshError, match="lie in one place"):
        light_transfer(np.zeros((V, 3)), FACES, fibonacci_sphere(4))


@pytest.mark.parametrize("colour", [0.0, 1e-300])
@pytest.mark.parametrize("channel", [slice(None), slice(0, 1)])
def test_black_images_give_light_that_is_finite(colour, channel):
    colours = np.full((V, 3), 0.4)
    colours[:, channel] = colour
    _, light = fit_light([Observation(VERTICES.astype(float), colours, np.ones(V))], FACES)
    assert np.isfinite(light).all() and (light >= 0).all()
