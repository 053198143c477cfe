"""Parameters of all timesteps in one file."""

from dataclasses import replace

import numpy as np
import pytest
from miniature import ball_model

from carigs.errors import InputError
from carigs.exaggeration.gamma_path import straight_path
from carigs.head import HeadParameters, neutral, pose
from carigs.splat.formats.flame_param import read_flame_param, write_flame_param
from carigs.splat.rig.head_sequence import subject_sequence

MODEL = ball_model(subdivisions=1)
V, T = len(MODEL.v_template), 4


@pytest.fixture
def arrays():
    """As GaussianAvatars writes them."""
    rng = np.random.default_rng(0)
    sizes = {"translation": 3, "rotation": 3, "neck_pose": 3, "jaw_pose": 3, "eyes_pose": 6, "expr": 100}
    found = {name: 0.1 * rng.normal(size=(T, size)) for name, size in sizes.items()}
    found |= {"shape": rng.normal(size=300), "static_offset": 0.001 * rng.normal(size=(1, V, 3))}
    found["dynamic_offset"] = np.ones((T, V, 3))  # ignored, as in both programs
    return {name: value.astype(np.float32) for name, value in found.items()}


def save(folder, arrays):
    np.savez(folder / "flame_param.npz", **arrays)
    return folder / "flame_param.npz"


def test_every_timestep_is_posed_as_from_a_file_of_its_own(arrays, tmp_path):
    parameters = read_flame_param(save(tmp_path, arrays), MODEL)
    assert list(parameters) == list(range(T))
    for t in range(T):
        single = {
            name: arrays[name][t : t + 1] for name in arrays if len(arrays[name]) == T and name != "dynamic_offset"
        }
        np.savez(tmp_path / "single.npz", **single, shape=arrays["shape"], static_offset=arrays["static_offset"])
        expected = pose(MODEL, HeadParameters.load(tmp_path / "single.npz", MODEL))
        np.testing.assert_array_equal(pose(MODEL, parameters[t]), expected)


def test_offsets_of_the_subject_are_held_once(arrays, tmp_path):
    parameters = read_flame_param(save(tmp_path, arrays), MODEL)
    assert all(frame.static_offset is parameters[0].static_offset for frame in parameters.values())


@pytest.mark.parametrize("level", [0.0, 0.2])
def test_a_written_file_poses_the_subject_of_the_level(arrays, level, tmp_path):
    """The identity is in the static offset; joints follow it as they follow the identity."""
    parameters = read_flame_param(save(tmp_path, arrays), MODEL)
    vertices = neutral(MODEL, parameters[0])
    path = straight_path(vertices, MODEL.faces, 0.1 * vertices[:, ::-1], 0.25)
    sequence = subject_sequence(MODEL, parameters, path)
    write_flame_param(tmp_path / "b.npz", sequence, MODEL, level)
    with np.load(tmp_path / "b.npz") as written:
        assert written["static_offset"].shape == (1, V, 3) and written["dynamic_offset"].shape == (T, V, 3)
        assert all(array.dtype == np.float32 for array in written.values())
    back = read_flame_param(tmp_path / "b.npz", MODEL)
    for t in range(T):
        np.testing.assert_allclose(pose(MODEL, back[t]), sequence.posed(t, level), atol=1e-6)


def test_a_model_of_another_head_is_refused(arrays, tmp_path):
    parameters = read_flame_param(save(tmp_path, arrays), MODEL)
    vertices = neutral(MODEL, parameters[0])
    sequence = subject_sequence(MODEL, parameters, straight_path(vertices, MODEL.faces, vertices, 0.25))
    with pytest.raises(InputError, match="must be the avatar's"):
        write_flame_param(tmp_path / "b.npz", sequence, replace(MODEL, faces=MODEL.faces[::-1]), 0.0)


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("expr", None),
        ("shape", None),
        ("translation", None),
        ("jaw_pose", lambda a: a[:-1]),
        ("rotation", lambda a: a[:, :2]),
        ("eyes_pose", lambda a: a[:, :3]),
        ("neck_pose", lambda a: a[0]),
        ("expr", lambda a: a[0]),
        ("expr", lambda a: a[:0]),
        ("expr", lambda a: np.zeros((T, 101))),
        ("shape", lambda a: np.zeros(301)),
        ("static_offset", lambda a: a[:, :-1]),
        ("translation", lambda a: a * np.nan),
        ("expr", lambda a: np.full(a.shape, "x")),
    ],
)
def test_a_wrong_array_is_named(name, change, arrays, tmp_path):
    if change is None:
        del arrays[name]
    else:
        arrays[name] = change(arrays[name])
    with pytest.raises(InputError, match=r"flame_param\.npz: ") as raised:
        read_flame_param(save(tmp_path, arrays), MODEL)
    assert "\n" not in str(raised.value)
    assert name in str(raised.value) or "a row for each timestep" in str(raised.value)
