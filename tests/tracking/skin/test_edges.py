"""Edges that move as a head model cannot: after landmarks have seen them, they lie where they were seen."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_head import small_head

from carigs.capture import look_at
from carigs.head import HeadModel, HeadParameters, SurfacePoints, pose
from carigs.tracking.cameras import Cameras
from carigs.tracking.skin.edges import edge_expressions

COUNT, SIZE, FOCAL = 32, 240, 900.0
MOVED = 0.003
"""Metres."""
MATRICES = np.stack([
    look_at(np.array([np.sin(angle), 0.1, np.cos(angle)]), np.zeros(3)) for angle in (0.0, 0.3)
])  # fmt: skip


@pytest.fixture(scope="module")
def model() -> HeadModel:
    return small_head(subdivisions=4)


@pytest.fixture(scope="module")
def edge(model) -> SurfacePoints:
    """Points in the middle of the face, some millimetres from each other."""
    front = model.v_template[:, 2].argmax()
    near = np.linalg.norm(model.v_template - model.v_template[front], axis=1) < 0.02
    return SurfacePoints.at_vertices(np.flatnonzero(near))


def cameras(count: int) -> Cameras:
    vectors = Rotation.from_matrix(MATRICES[:count, :3, :3]).as_rotvec()
    poses = np.hstack([vectors, MATRICES[:count, :3, 3]])
    return Cameras(np.full(count, FOCAL), np.full((count, 2), SIZE / 2), poses)


def seen(model: HeadModel, edge: SurfacePoints, parameters: list[HeadParameters], count: int) -> np.ndarray:
    posed = np.stack([edge.interpolate(pose(model, frame)) for frame in parameters])
    return cameras(count).project(posed)[0]


@pytest.mark.parametrize("count", [1, 2])
def test_edges_follow_what_landmarks_see(model, edge, count):
    """They move with the turning head, in a way that no blendshape has."""
    random = np.random.default_rng(0)
    shape = np.zeros_like(model.v_template, np.float64)
    shape[edge.corners[:, 0]] = [0.3 * MOVED, MOVED, 0.0]
    amplitudes = random.normal(size=COUNT)
    turns = [np.array([0.1 * np.sin(i), 0.2 * np.cos(2 * i), 0.0]) for i in range(COUNT)]
    thought = [replace(HeadParameters.zeros(model), rotation=turn) for turn in turns]
    true = [replace(frame, static_offset=a * shape) for frame, a in zip(thought, amplitudes, strict=True)]
    pixels = seen(model, edge, true, count)
    observed = pixels.copy()
    observed[3, 0, :2] = np.nan  # landmarks that do not count
    observed[4:20, :, 3] = np.nan  # seen in few frames
    larger, parameters = edge_expressions(model, thought, cameras(count), edge, np.ones(len(edge), bool), observed)
    assert larger.num_expressions > model.num_expressions

    before, after = (
        np.linalg.norm(found - pixels, axis=-1).mean()
        for found in (seen(model, edge, thought, count), seen(larger, edge, parameters, count))
    )
    assert after < 0.2 * before


def test_few_timesteps_and_models_without_these_landmarks_change_nothing(model, edge):
    few = [HeadParameters.zeros(model)] * 4
    pixels = seen(model, edge, few, 1)
    assert edge_expressions(model, few, cameras(1), edge, np.ones(len(edge), bool), pixels) == (model, few)
    many = few * 8
    nothing = edge[np.zeros(0, int)]
    assert edge_expressions(model, many, cameras(1), nothing, np.zeros(0, bool), np.zeros((len(many), 1, 0, 2))) == (
        model,
        many,
    )


def test_lips_are_moved_by_the_same_in_all_frames(model, edge):
    random = np.random.default_rng(1)
    frames = [replace(HeadParameters.zeros(model), rotation=np.array([0, 0.2 * np.cos(i), 0])) for i in range(COUNT)]
    off = random.normal(0, 2.0, (len(edge), 2)) + random.normal(0, 1.0, (COUNT, 1, len(edge), 2))
    pixels = seen(model, edge, frames, 1)
    larger, parameters = edge_expressions(model, frames, cameras(1), edge, np.zeros(len(edge), bool), pixels + off)
    added = np.stack([frame.expression[model.num_expressions :] for frame in parameters])
    moved = np.einsum("te,vxe->tvx", added, larger.expression_basis[..., model.num_expressions :])
    np.testing.assert_allclose(moved, moved[:1].repeat(COUNT, axis=0), atol=1e-8)
    assert np.linalg.norm(seen(larger, edge, parameters, 1) - pixels - off.mean(axis=0), axis=-1).mean() < 0.7
