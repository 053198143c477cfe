"""Every array of an avatar is checked when it is loaded: names, shapes, kinds of numbers, finiteness, ranges."""

from __future__ import annotations

import tracemalloc
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


def changed(**changes):
    """A change of the avatar's arrays: a function of each array, or its new value."""
    return lambda arrays: {name: f(arrays[name].copy()) if callable(f) else np.array(f) for name, f in changes.items()}


def put(value, *index):
    def change(array):
        array = array.astype(np.result_type(array.dtype, np.array(value).dtype))
        array[index] = value
        return array

    return change


def scaled(factor):
    return lambda array: (factor * array).astype(array.dtype)


DISAGREEING = {
    "skinning weights that do not sum to 1": (changed(head_weights=scaled(7)), "head_weights"),
    "half of the skinning weights": (changed(head_weights=scaled(0.5)), "head_weights"),
    "one vertex without weights": (changed(head_weights=put(0, 3)), "head_weights: the weights of vertex 3 sum to 0"),
    "negative weights that sum to 1": (changed(head_weights=put([2, -1, 0, 0, 0], 5)), "head_weights: 2 at"),
    "joints that are no mean of vertices": (changed(head_J_regressor=scaled(2)), "head_J_regressor"),
    "a triangle that names a vertex twice": (changed(head_f=put([1, 2, 1], 4)), "head_f: triangle 4"),
    "triangles without area": (changed(head_f=lambda f: np.zeros_like(f)), "head_f: triangle 0"),
    "a head of one point": (
        changed(head_v_template=scaled(0), path_neutral=scaled(0)), "head_v_template: no triangle"
    ),
    "joints in a circle": (changed(head_kintree_table=[[-1, 2, 1, 1, 1], [0, 1, 2, 3, 4]]), "head_kintree_table"),
    "two joints of one name": (changed(head_joint_names=["a", "b", "b", "c", "d"]), "head_joint_names"),
    "more names than expressions": (
        changed(head_expression_names=[f"e{i}" for i in range(EXPRESSIONS + 1)]), "head_expression_names"
    ),
    "two expressions of one name": (changed(head_expression_names=["a", "a"]), "head_expression_names"),
    "a path of a larger head": (changed(path_neutral=scaled(1.2)), "path_neutral: differs from the subject's"),
    "a path of a shifted head": (changed(path_neutral=lambda v: v + 0.001), "path_neutral: differs"),
    "a path that leaves the world": (changed(path_displacements=put(1e20, 1, 2, 0)), "path_displacements"),
    "blendshapes that leave the world": (changed(path_changes=put(1e20, 0, 0, 2, 0)), "path_changes"),
    "levels out of order": (
        changed(path_levels=[0, 0.2, 0.1], path_displacements=lambda d: d[[0, 1, 1]],
                path_changes=lambda c: c[[0, 0]]), "path_levels",
    ),
    "a blendshape that changes twice": (
        changed(path_columns=[0, 0], path_changes=lambda c: c[:, [0, 0]]), "path_columns: an index appears twice"
    ),
    "a rotation of many turns": (changed(pose_rotation=put(1e6, 1, 0)), "pose_rotation: a rotation of 1e\\+06 rad"),
    "a rotation in degrees": (changed(pose_rotation=put(90.0, 0, 1)), "pose_rotation"),
    "a jaw in degrees": (changed(pose_joints=put(30.0, 0, 1, 0)), "pose_joints"),
    "a head far away": (changed(pose_translation=put(1e5, 0, 2)), "pose_translation: 100000 at"),
    "an expression beyond all faces": (changed(pose_expression=put(-1e9, 0, 2)), "pose_expression: -1e\\+09 at"),
    "a surfel without direction": (changed(surfel_rotation=put(0, 7)), "surfel_rotation: the quaternion of surfel 7"),
    "a surfel that covers everything": (changed(surfel_log_scale=put(50, 3, 1)), "surfel_log_scale: 50 at"),
    "an opacity that no logit has": (changed(surfel_opacity=put(1e30, 2)), "surfel_opacity: 1e\\+30 at"),
    "a colour brighter than the sun": (changed(surfel_colour=put(-1e20, 2, 0)), "surfel_colour"),
    "a surfel in the next town": (changed(surfel_position=put(1e9, 2, 0)), "surfel_position"),
    "light from more directions than are possible": (
        changed(shading_directions=lambda d: np.repeat(d, 200, axis=0), shading_light=np.ones((1601, 3))),
        "shading_directions: 1600 directions",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", DISAGREEING)
def test_arrays_that_disagree_are_refused(case, arrays, tmp_path):
    """Each of these was drawn."""
    change, says = DISAGREEING[case]
    with pytest.raises(InputError, match=rf"a\.npz: {says}"):
        load_avatar(save(tmp_path, {**arrays, **change(arrays)}))


@pytest.mark.parametrize("seed", range(3))
def test_sound_heads_hold_what_is_asked_of_them(seed, tmp_path):
    """What arrays must agree in holds for every head that carigs makes, after float32 and a round trip, too."""
    head = HeadModel.load(gnm_file(tmp_path, gnm_like(seed)))
    head.save(tmp_path / "head.npz")
    again = HeadModel.load(tmp_path / "head.npz")
    np.testing.assert_array_equal(again.weights, head.weights)


def test_an_avatar_without_surfels_is_refused(arrays, tmp_path):
    empty = {name: array[:0] for name, array in arrays.items() if name.startswith("surfel_")}
    with pytest.raises(InputError, match="surfel_binding: holds no surfels"):
        load_avatar(save(tmp_path, {**arrays, **empty}))


@pytest.mark.parametrize("name", ["rig", "format", "head_expression_names"])
@pytest.mark.parametrize("code", [0x110000, 0xFFFFFFFF, 0xD800])
@pytest.mark.parametrize("order", ["<", ">"])
def test_characters_that_do_not_exist_are_refused(name, code, order, arrays, tmp_path):
    """NumPy stores any number as a character; Python cannot make a text of it."""
    text = np.atleast_1d(arrays[name]).astype(arrays[name].dtype.newbyteorder(order))
    text.view(f"{order}u4")[0] = code
    text = text.reshape(arrays[name].shape)
    with pytest.raises(InputError, match=rf"a\.npz: {name}: holds a text with a character that does not exist"):
        load_avatar(save(tmp_path, {**arrays, name: text}))


@pytest.mark.parametrize("name", ["rig", "format"])
@pytest.mark.parametrize("value", [["jbs"], 3.0, b"jbs", np.zeros((2, 2), "U1")], ids=str)
def test_what_is_no_text_is_refused(name, value, arrays, tmp_path):
    with pytest.raises(InputError, match=rf"a\.npz: {name}: "):
        load_avatar(save(tmp_path, {**arrays, name: np.array(value)}))


# What a small file becomes in memory.


def peak_of(work):
    """Largest number of bytes that NumPy and Python allocated meanwhile."""
    tracemalloc.start()
    try:
        work()
        return tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def large_head(arrays, vertices, columns, blendshapes):
    """The avatar with many vertices that no triangle uses, and a few of many blendshapes."""

    def rows(name, axis=0):
        array = arrays[name]
        return np.repeat(array.take([0], axis), vertices, axis)

    return {
        **arrays,
        **{f"head_{name}": rows(f"head_{name}") for name in ("v_template", "weights")},
        "head_posedirs": np.zeros((vertices, 3, 0), np.float32),
        "head_J_regressor": np.full((5, vertices), 1 / vertices, np.float32),
        "head_shapedirs": np.zeros((vertices, 3, columns), np.float32),
        "head_columns": np.arange(columns),
        "head_blendshapes": np.array(blendshapes),
        "head_num_identity": np.array(0),
    }


@pytest.mark.parametrize(
    ("vertices", "columns", "blendshapes"), [(300_000, 1, 2000), (100_000, 1, 1000), (30_000, 0, 2000)]
)
def test_blendshapes_that_are_not_stored_take_no_memory(vertices, columns, blendshapes, arrays, tmp_path):
    """300 000 vertices with one stored blendshape of 2000: 8 MB took 9.1 GB."""
    file = save(tmp_path, large_head(arrays, vertices, columns, blendshapes))

    def load():
        with pytest.raises(InputError, match=r"a\.npz: head_blendshapes: "):
            load_avatar(file)

    assert peak_of(load) < 100e6


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("surfel_harmonics", np.zeros((20_000_000, 15, 1), np.int8)),
        ("pose_expression", np.zeros((2, 150_000_000), bool)),
        ("unknown", np.zeros(700_000_000, np.int8)),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
@pytest.mark.slow
def test_compressed_zeros_are_refused(name, value, arrays, tmp_path):
    np.savez_compressed(tmp_path / "a.npz", **{**arrays, name: value})
    file = tmp_path / "a.npz"
    assert file.stat().st_size < 1e6

    def load():
        with pytest.raises(InputError, match=r"a\.npz: "):
            load_avatar(file)

    assert peak_of(load) < 1.5e9


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
