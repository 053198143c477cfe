"""The procedural head model: a manifold with one neck opening and two eyeballs, a rig that does what faces do."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from carigs.head import HeadModel, HeadParameters, flame_joints, neutral, pose
from carigs.toy.rig.head_model import head_model
from carigs.toy.rig.identity import ASYMMETRIC, NAMES

MIRROR = np.array([-1.0, 1.0, 1.0])


@pytest.fixture(scope="module")
def model() -> HeadModel:
    return head_model()


@pytest.fixture(scope="module")
def twin(model: HeadModel) -> np.ndarray:
    """The vertex at the mirror image of each vertex, found by position."""
    rest = model.v_template.astype(float)
    distance, ids = cKDTree(rest).query(rest * MIRROR)
    assert distance.max() < 1e-6
    return ids


def expression(model: HeadModel, **weights: float) -> np.ndarray:
    code = np.zeros(100)
    for name, weight in weights.items():
        code[model.expression_names.index(name)] = weight
    return code


def directed_edges(faces: np.ndarray) -> np.ndarray:
    return faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)


def test_it_is_an_oriented_manifold(model: HeadModel) -> None:
    edges = directed_edges(model.faces)
    # No directed edge twice: at most two faces on an edge, and they run it in opposite directions.
    assert len(np.unique(edges, axis=0)) == len(edges)
    # Around each vertex the faces form a single fan: as many edges as faces, or one more at the border.
    undirected = np.unique(np.sort(edges, axis=1), axis=0)
    excess = np.bincount(undirected.reshape(-1)) - np.bincount(model.faces.reshape(-1))
    assert set(np.unique(excess)) == {0, 1}


def test_three_components_and_one_opening_at_the_neck(model: HeadModel) -> None:
    edges = directed_edges(model.faces)
    v = len(model.v_template)
    graph = coo_matrix((np.ones(len(edges)), edges.T), (v, v))
    count, label = connected_components(graph, directed=False)
    assert count == 3
    euler = []
    for component in range(3):
        inside = label == component
        own = np.sort(edges[inside[edges[:, 0]]], axis=1)
        euler.append(inside.sum() - len(np.unique(own, axis=0)) + inside[model.faces[:, 0]].sum())
    assert sorted(euler) == [1, 2, 2]  # a sphere with one hole, two closed spheres
    known = {tuple(edge) for edge in edges}
    border = np.array([edge for edge in known if edge[::-1] not in known])
    loops, _ = connected_components(coo_matrix((np.ones(len(border)), border.T), (v, v)), directed=False)
    assert loops == v - len(border) + 1  # one loop, every other vertex alone
    assert np.ptp(model.v_template[border[:, 0], 1]) < 1e-6
    assert model.v_template[border[0, 0], 1] == model.v_template[:, 1].min()


def test_triangles_are_well_shaped(model: HeadModel) -> None:
    corners = model.v_template[model.faces].astype(float)
    sides = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1) / 2
    quality = 4 * np.sqrt(3) * area / (sides**2).sum(axis=1)  # 1 for equilateral triangles, 0 for degenerate ones
    assert quality.min() > 0.02 and np.percentile(quality, 1) > 0.4 and np.median(quality) > 0.9


def test_size_and_axes_are_those_of_a_head_in_metres(model: HeadModel) -> None:
    rest = model.v_template
    assert 3000 <= len(rest) <= 6000
    assert np.ptp(rest, axis=0) == pytest.approx([0.19, 0.31, 0.22], abs=0.03)
    nose = rest[model.regions["nose"]]
    assert nose[:, 2].max() == rest[:, 2].max()  # the face looks along +z
    assert rest[model.regions["left_ear"], 0].min() > 0 > rest[model.regions["right_ear"], 0].max()
    volume = np.einsum("fi,fi->f", *(lambda c: (c[:, 0], np.cross(c[:, 1], c[:, 2])))(rest[model.faces].astype(float)))
    assert volume.sum() / 6 == pytest.approx(0.0050, abs=0.0012)  # five litres, faces outward


def test_left_and_right_are_mirror_images(model: HeadModel, twin: np.ndarray) -> None:
    mirrored = {tuple(sorted(face)) for face in twin[model.faces]}
    assert mirrored == {tuple(sorted(face)) for face in model.faces}
    for name, ids in model.regions.items():
        other = name.replace("left", "RIGHT").replace("right", "left").replace("RIGHT", "right")
        differing = set(twin[ids]) ^ set(model.regions[other])
        assert all(model.v_template[v, 0] == 0 for v in differing), name
    for i, name in enumerate(NAMES):
        moved = model.shapedirs[:, :, i]
        error = np.abs(moved[twin] * MIRROR - moved).max()
        assert (error > 1e-4) if name in ASYMMETRIC else (error < 1e-6), name
    for i, name in enumerate(model.expression_names):
        if name.endswith("_left"):
            j = model.expression_names.index(name.replace("left", "right"))
            left, right = model.shapedirs[:, :, 300 + i], model.shapedirs[:, :, 300 + j]
            np.testing.assert_allclose(left[twin] * MIRROR, right, atol=1e-6, err_msg=name)


def test_regions(model: HeadModel) -> None:
    v = len(model.v_template)
    region = {name: np.isin(np.arange(v), ids) for name, ids in model.regions.items()}
    flame = "face neck scalp boundary right_eyeball left_eyeball right_ear left_ear forehead eye_region nose lips"
    assert set(flame.split()) | {"left_eye_region", "right_eye_region", "lip_inside", "left_eyelid"} <= set(region)
    apart = ["face", "neck", "scalp", "boundary", "left_eyeball", "right_eyeball", "left_ear", "right_ear"]
    assert sum(region[name].astype(int) for name in apart).max() == 1
    assert (region["eye_region"] == (region["left_eye_region"] | region["right_eye_region"])).all()
    for part in ("nose", "lips", "eye_region", "forehead", "brows"):
        assert region[part].any() and not (region[part] & ~region["face"]).any(), part
    # The eyeballs are their components: no face joins them to anything else.
    for name in ("left_eyeball", "right_eyeball"):
        inside = region[name][model.faces]
        assert (inside.all(axis=1) == inside.any(axis=1)).all()


def test_joints_follow_from_the_vertices_and_lie_inside(model: HeadModel) -> None:
    np.testing.assert_allclose(model.joint_regressor.sum(axis=1), 1, atol=1e-5)
    rest = model.v_template.astype(float)
    joints = model.joint_regressor @ rest
    for joint, name in ((3, "left_eyeball"), (4, "right_eyeball")):
        assert (
            np.ptp(np.linalg.norm(rest[model.regions[name]] - joints[joint], axis=1)) < 1e-6
        )  # the middle of the ball
    # Solid angle of the head (van Oosterom and Strackee 1983): 4 pi from inside, less the neck's opening.
    for joint in joints[:3]:
        a, b, c = np.moveaxis(rest[model.faces] - joint, 1, 0)
        la, lb, lc = (np.linalg.norm(x, axis=1) for x in (a, b, c))
        triple = np.einsum("fi,fi->f", a, np.cross(b, c))
        rest_of = la * lb * lc + (a * b).sum(1) * lc + (b * c).sum(1) * la + (c * a).sum(1) * lb
        assert 2 * np.arctan2(triple, rest_of).sum() > 2.2 * np.pi


def test_skin_weights_are_a_partition_of_unity(model: HeadModel) -> None:
    assert model.weights.min() >= 0
    np.testing.assert_allclose(model.weights.sum(axis=1), 1, atol=1e-6)
    assert (model.weights[model.regions["left_eyeball"], 3] == 1).all()
    turned = pose(model, HeadParameters(joints=flame_joints(left_eye=[0.1, 0.2, 0], right_eye=[0.1, 0.2, 0])))
    moved = np.linalg.norm(turned - model.v_template, axis=1) > 1e-6
    assert not (moved & ~model.vertex_region("left_eyeball", "right_eyeball")).any()


def test_eyeballs_stay_round_in_every_person(model: HeadModel) -> None:
    rng = np.random.default_rng(3)
    for _ in range(5):
        shape = np.zeros(300)
        shape[: len(NAMES)] = rng.uniform(-2, 2, len(NAMES))
        for name in ("left_eyeball", "right_eyeball"):
            ball = neutral(model, HeadParameters(shape=shape))[model.regions[name]]
            # The sphere through the vertices: |p|^2 = 2 c.p + k.
            system = np.concatenate([2 * ball, np.ones((len(ball), 1))], axis=1)
            fit = np.linalg.lstsq(system, (ball**2).sum(axis=1), rcond=None)
            radius = np.linalg.norm(ball - fit[0][:3], axis=1)
            assert np.ptp(radius) < 1e-6 and 0.009 < radius.mean() < 0.016


def test_a_blink_closes_the_lids_over_the_eyeball(model: HeadModel) -> None:
    lids = [(37, 41), (38, 40), (43, 47), (44, 46)]
    upper, lower = model.landmarks68.corners[np.array(lids).T, 0]
    blink = HeadParameters(expression=expression(model, eye_blink_left=1.0, eye_blink_right=1.0))
    before, after = pose(model, HeadParameters()), pose(model, blink)
    opened = before[upper, 1] - before[lower, 1]
    closed = after[upper, 1] - after[lower, 1]
    assert opened.min() > 0.006
    assert closed.max() < 0.1 * opened.min() and closed.min() > -0.003
    # The lids pass in front of the ball, not through it.
    joints = model.joint_regressor @ model.v_template
    for side, joint, name in ((1, 3, "left_eyeball"), (-1, 4, "right_eyeball")):
        radius = np.linalg.norm(model.v_template[model.regions[name][0]] - joints[joint])
        own = side * after[upper, 0] > 0
        assert np.linalg.norm(after[upper[own]] - joints[joint], axis=1).min() > radius


def test_the_jaw_opens_the_mouth(model: HeadModel) -> None:
    upper, lower, chin, nose = model.landmarks68.corners[[62, 66, 8, 30], 0]
    shut = pose(model, HeadParameters())
    assert 0 < shut[upper, 1] - shut[lower, 1] < 0.004
    by_joint = pose(model, HeadParameters(joints=flame_joints(jaw=[0.3, 0, 0])))
    by_shape = pose(model, HeadParameters(expression=expression(model, jaw_open=1.0)))
    for opened in (by_joint, by_shape):
        assert opened[upper, 1] - opened[lower, 1] > 0.02
        assert shut[chin, 1] - opened[chin, 1] > 0.015
        assert np.linalg.norm(opened[[upper, nose]] - shut[[upper, nose]], axis=1).max() < 0.001
    # The same motion twice: the expression is the joint's turn, frozen at one angle.
    assert np.abs(by_joint - by_shape).max() < 1e-4


def test_expressions_move_what_they_name(model: HeadModel) -> None:
    rest = pose(model, HeadParameters())
    corner, brow = model.landmarks68.corners[[54, 24], 0]

    def change(vertex: int, axis: int, **weights: float) -> float:
        return (pose(model, HeadParameters(expression=expression(model, **weights))) - rest)[vertex, axis]

    assert change(corner, 1, mouth_smile_left=1.0) > 0.003
    assert change(corner, 1, mouth_frown_left=1.0) < -0.003
    assert change(corner, 0, mouth_pucker=1.0) < -0.003
    assert change(corner, 0, mouth_left=1.0) > 0.003 and change(corner, 0, mouth_right=1.0) < -0.003
    assert change(brow, 1, brow_inner_up_left=0.5, brow_outer_up_left=0.5) > 0.001
    assert change(brow, 1, brow_down_left=1.0) < -0.002
    assert abs(change(brow, 1, brow_down_right=1.0)) < 1e-4


def test_landmarks_come_in_mirrored_pairs(model: HeadModel) -> None:
    pairs = [(i, 16 - i) for i in range(9)] + [(17 + i, 26 - i) for i in range(5)]
    pairs += [
        (36, 45),
        (37, 44),
        (38, 43),
        (39, 42),
        (40, 47),
        (41, 46),
        (48, 54),
        (49, 53),
        (50, 52),
        (59, 55),
        (58, 56),
    ]
    pairs += [(31, 35), (32, 34), (60, 64), (61, 63), (67, 65)]
    points = model.landmarks68.interpolate(model.v_template)
    right, left = np.array(pairs).T
    np.testing.assert_allclose(points[right] * MIRROR, points[left], atol=1e-6)
    assert np.abs(points[[8, 27, 28, 29, 30, 33, 51, 57, 62, 66], 0]).max() < 0.002
    assert (np.diff(points[[27, 28, 29, 30, 33, 51, 62, 66, 57, 8], 1]) < 0).all()  # down the midline


def test_the_file_is_read_back_as_it_was_written(model: HeadModel, tmp_path) -> None:
    model.save(tmp_path / "head.npz")
    again = HeadModel.load(tmp_path / "head.npz")
    for name in ("v_template", "faces", "shapedirs", "joint_regressor", "weights"):
        np.testing.assert_array_equal(getattr(again, name), getattr(model, name))
    np.testing.assert_array_equal(again.landmarks68.corners, model.landmarks68.corners)
    assert again.expression_names == model.expression_names and set(again.regions) == set(model.regions)
    assert len(again.expression_names) >= 10 and (np.abs(again.shapedirs[:, :, :300]).max(axis=(0, 1)) > 0).sum() >= 10
