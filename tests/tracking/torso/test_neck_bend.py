"""The root follows the torso, and the head stays where it was tracked."""

from dataclasses import replace

import numpy as np
import pytest
from heads import random_model
from scipy.spatial.transform import Rotation

from carigs.head import HeadModel, HeadParameters, pose
from carigs.head.model_arrays import RestJoints
from carigs.toy import head_model
from carigs.tracking.torso.neck_bend import NECK, bend_neck, bend_with_torso, skull_motion

COUNT = 6


def model_of(kind: str) -> HeadModel:
    if kind == "toy":
        return head_model()
    model = random_model(v=60, identities=4, expressions=3)
    weights = model.weights.copy()
    weights[:20], weights[20:40] = [1, 0, 0, 0, 0], [0, 1, 0, 0, 0]
    model = replace(model, weights=weights)
    if kind == "joints of their own":
        rest = np.random.default_rng(1).normal(size=(5, 3)).astype(np.float32)
        model = replace(model, rest_joints=RestJoints(rest, np.zeros((5, 3, 7), np.float32)))
    return model


def talking(model: HeadModel, random: np.random.Generator) -> list[HeadParameters]:
    zero = HeadParameters.zeros(model)
    return [
        replace(
            zero,
            rotation=random.normal(0, 0.3, 3),
            translation=random.normal(0, 0.1, 3),
            joints=random.normal(0, 0.2, zero.joints.shape),
            expression=random.normal(0, 0.5, zero.expression.shape),
        )
        for _ in range(COUNT)
    ]


def rigid(random: np.random.Generator) -> np.ndarray:
    matrices = np.tile(np.eye(4), (COUNT, 1, 1))
    matrices[:, :3, :3] = Rotation.from_rotvec(random.normal(0, 0.1, (COUNT, 3))).as_matrix()
    matrices[:, :3, 3] = random.normal(0, 0.05, (COUNT, 3))
    return matrices


def moved(matrix: np.ndarray, points: np.ndarray) -> np.ndarray:
    return points @ matrix[:3, :3].T + matrix[:3, 3]


@pytest.mark.parametrize("kind", ["toy", "five joints", "joints of their own"])
def test_the_skull_stays_and_what_the_root_carries_follows_the_torso(kind):
    random = np.random.default_rng(3)
    model = model_of(kind)
    before, torso = talking(model, random), rigid(random)
    before = [replace(frame, expression=0 * frame.expression) for frame in before]
    larger, after = bend_neck(model, before, torso)
    np.testing.assert_allclose(skull_motion(larger, after)[:, :3, :3], skull_motion(model, before)[:, :3, :3])
    model, larger = (replace(each, posedirs=0 * each.posedirs) for each in (model, larger))  # they follow other angles
    head, base = model.weights[:, NECK] > 1 - 1e-6, model.weights[:, 0] > 1 - 1e-6
    if kind != "five joints":  # whose jaw is the mean of vertices all over the head, as no jaw is
        head = model.weights[:, 0] < 1e-6
    assert head.any() and base.any()
    rest = None
    for t, (old, new) in enumerate(zip(before, after, strict=True)):
        np.testing.assert_allclose(pose(larger, new)[head], pose(model, old)[head], atol=2e-5)
        placed = moved(np.linalg.inv(torso[t]), pose(larger, new)[base])
        rest = placed if rest is None else rest
        np.testing.assert_allclose(placed, rest, atol=2e-5)


def test_on_the_average_the_neck_does_not_bend():
    random = np.random.default_rng(4)
    model = model_of("toy")
    before = talking(model, random)
    _, after = bend_neck(model, before, rigid(random))
    turns = Rotation.from_rotvec([frame.joints[NECK - 1] for frame in after])
    assert turns.mean().magnitude() < 0.3 * np.median(turns.magnitude())


def test_nothing_changes_where_no_torso_is_seen():
    model = model_of("toy")
    before = talking(model, np.random.default_rng(5))
    same, after = bend_with_torso(model, before, [[] for _ in before])
    assert same is model and after == before
