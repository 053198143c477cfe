"""The head as glTF with joints and animations, evaluated by an oracle, is the head that the model poses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from avatars import ball_avatar, ball_sequence
from small_head import small_head
from splat.formats.gltf_oracle import Gltf

from carigs.exaggeration.gamma_path import GammaPath, lobatto_levels
from carigs.head import HeadParameters, pose
from carigs.splat.formats.animated_head import HeadClip, write_animated_head
from carigs.splat.formats.baked_colours import baked_colours, linear_colours
from carigs.splat.rig.head_sequence import HeadSequence


def moving_sequence() -> HeadSequence:
    """A head whose joints move with its expressions, with pose correctives and expressions that change along a path."""
    model, rng = small_head(subdivisions=2), np.random.default_rng(0)
    names = ("jawOpen", "mouthSmile_L", "mouthSmile_R")
    model = replace(model, num_identity=0, shapedirs=model.shapedirs[:, :, 6:], expression_names=names)
    neutral, levels = model.v_template.astype(np.float64), lobatto_levels(3, 0.25)
    growth = 0.05 * rng.normal(size=neutral.shape)
    changes = 0.003 * rng.normal(size=(2, 7, *neutral.shape)).astype(np.float32)
    displacements = np.stack([(level + 2 * level**2) * growth for level in levels]).astype(np.float32)
    path = GammaPath(
        levels, displacements, model.faces, neutral, columns=np.array([0, 2, 5, 8, 20, 33, 40]), changes=changes
    )
    frames = {
        t: HeadParameters(
            translation=0.1 * rng.normal(size=3), rotation=0.5 * rng.normal(size=3),
            joints=0.4 * rng.normal(size=(4, 3)), shape=np.zeros(0), expression=rng.normal(size=5),
        )
        for t in range(5)
    }  # fmt: skip
    return HeadSequence(model, frames, path)


@pytest.fixture(scope="module")
def sequence():
    return moving_sequence()


@pytest.mark.parametrize("level", [0.0, 0.13, 0.25])
def test_frames_of_an_animation_are_the_posed_head(sequence, level, tmp_path):
    frames = [sequence.parameters[t] for t in (3, 1, 4)]
    write_animated_head(tmp_path / "a.glb", sequence, level, {"take": HeadClip(25.0, frames)})
    gltf = Gltf(tmp_path / "a.glb")
    caricature = sequence.path.at(level) if level else None
    for place, frame in enumerate(frames):
        expected = pose(sequence.head, frame, caricature)
        np.testing.assert_allclose(gltf.vertices("take", place), expected, atol=1e-6)
    times = gltf.array(gltf.document["animations"][0]["samplers"][0]["input"])[:, 0]
    np.testing.assert_allclose(times, [0, 0.04, 0.08], atol=1e-7)


def test_targets_have_names_and_move_what_they_say(sequence, tmp_path):
    head, path = sequence.head, sequence.path
    region = GammaPath(path.levels, 0.3 * path.displacements, path.faces, path.neutral)
    write_animated_head(tmp_path / "a.glb", sequence, 0.25, {}, regions={"nose": region})
    gltf = Gltf(tmp_path / "a.glb")
    assert gltf.names[:4] == ["level", "jawOpen", "mouthSmile_L", "mouthSmile_R"]
    assert {"smile", "nose", "expression 3", "corrective 35"} <= set(gltf.names) and "animations" not in gltf.document
    assert [node["name"] for node in gltf.document["nodes"]] == ["head", *head.joint_names]
    places = {name: gltf.names.index(name) for name in gltf.names}
    smile = gltf.targets[places["mouthSmile_L"]] + gltf.targets[places["mouthSmile_R"]]
    np.testing.assert_allclose(gltf.targets[places["smile"]], smile, atol=1e-7)
    np.testing.assert_allclose(gltf.targets[places["nose"]], region.displacements[-1], atol=1e-7)
    np.testing.assert_allclose(gltf.vertices(), sequence.posed(0, 0.25), atol=1e-6)  # at rest, at the level


def test_what_does_not_move_is_not_stored(tmp_path):
    sequence = ball_sequence(lit=False)
    write_animated_head(tmp_path / "a.glb", sequence, 0.25, {})
    gltf = Gltf(tmp_path / "a.glb")
    jaw = gltf.document["accessors"][gltf.primitive["targets"][1]["POSITION"]]
    moved = sequence.head.expression_basis[:, :, 0].any(axis=1).sum()
    assert gltf.names == ["level", "jawOpen"] and jaw["sparse"]["count"] == moved < len(gltf.base) / 2


def test_colours_of_vertices_are_those_of_the_rendering():
    """Surfels of one colour: every vertex has it, also those that no camera sees."""
    avatar = ball_avatar(sh_degree=0, lit=False)
    with np.errstate(all="ignore"):
        avatar.surfels.colour.data[:] = avatar.surfels.colour.data[:1]
        avatar.surfels.log_scale.data += 1.0
        avatar.surfels.opacity.data[:] = 20.0
    vertices = avatar.sequence.posed(1, 0.1)
    found = baked_colours(avatar, vertices)
    only = (0.5 + 0.28209479177387814 * avatar.surfels.colour.data[0].numpy()).clip(0, 1)
    np.testing.assert_allclose(np.median(found, axis=0), only, atol=0.01)
    assert found.shape == vertices.shape and np.isfinite(found).all()


def test_linear_colours_are_the_inverse_of_srgb():
    values = np.linspace(0, 1, 102).reshape(-1, 3)
    linear = linear_colours(values).astype(np.float64)
    again = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    np.testing.assert_allclose(again, values, atol=1e-4)
    assert linear[0, 0] == 0 and linear[-1, -1] == 1
