"""FLAME's teeth: their mesh, their skinning, and their fit behind exaggerated lips."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from carigs.capture import Camera, Capture
from carigs.capture.dataset import Frame
from carigs.exaggeration import Exaggerator, GammaPath, straight_path
from carigs.head import HeadModel, HeadParameters, flame_joints, neutral, pose
from carigs.head.teeth import (
    FLAME_COUNTS,
    FLAME_WITH_TEETH_COUNTS,
    LOWER_LIP,
    ROWS,
    UPPER_LIP,
    add_teeth,
    skin_counts,
    teeth_faces,
    teeth_vertices,
    without_teeth,
)
from carigs.mesh.triangle_mesh import components
from carigs.settings import Exaggerate
from carigs.stages.exaggerate import exaggerate


def head(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A surface of FLAME's numbers: a bumpy tube and two closed balls; the lips' rings are two arcs in front of it."""
    random = np.random.default_rng(seed)
    tube, tube_faces = _rings(121, 31)
    ball, ball_faces = _ball(34, 37)
    small, small_faces = _ball(0, 0)
    vertices = np.concatenate([tube, 0.02 * ball + [0, 0, 0.05], 0.01 * small + [0.05, 0, 0.05]])
    faces = np.concatenate([tube_faces, ball_faces + len(tube), small_faces + len(tube) + len(ball)])
    assert (len(vertices), len(faces)) == FLAME_COUNTS
    return vertices * (1 + 0.05 * np.sin(40 * vertices[:, :1]) + 1e-4 * random.normal(size=vertices.shape)), faces


def _rings(rows: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """An open tube; its faces look outwards."""
    y, angle = np.meshgrid(np.linspace(-0.12, 0.12, rows), 2 * np.pi * np.arange(n) / n, indexing="ij")
    ids = np.arange(rows * n).reshape(rows, n)
    a, b, c, d = ids[:-1], np.roll(ids, -1, 1)[:-1], np.roll(ids, -1, 1)[1:], ids[1:]
    faces = np.concatenate([np.stack([a, d, c], -1).reshape(-1, 3), np.stack([a, c, b], -1).reshape(-1, 3)])
    return np.stack([0.1 * np.cos(angle), y, 0.1 * np.sin(angle)], -1).reshape(-1, 3), faces


def _ball(rows: int, n: int) -> tuple[np.ndarray, np.ndarray]:
    """A closed sphere of rows x n + 2 vertices; without rows an icosahedron."""
    import trimesh

    mesh = trimesh.creation.icosahedron()
    if rows:
        tilt, angle = np.meshgrid(np.linspace(0, np.pi, rows + 2)[1:-1], 2 * np.pi * np.arange(n) / n, indexing="ij")
        points = np.stack([np.sin(tilt) * np.cos(angle), np.cos(tilt), np.sin(tilt) * np.sin(angle)], -1)
        mesh = trimesh.convex.convex_hull(np.concatenate([points.reshape(-1, 3), [[0, 1, 0], [0, -1, 0]]]))
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def with_lips(vertices: np.ndarray) -> np.ndarray:
    """The same, with the rings' vertices on two arcs, from the person's left (+x) to the right."""
    lips, angle = vertices.copy(), np.linspace(0.9, -0.9, 15)
    arc = np.stack([0.03 * np.sin(angle), 0 * angle, 0.08 + 0.02 * np.cos(angle)], axis=1)
    lips[list(UPPER_LIP)] = arc + np.outer(0.006 * np.cos(angle), [0, 1, 0])
    lips[list(LOWER_LIP)] = arc - np.outer(0.005 * np.cos(angle), [0, 1, 0])
    return lips


def flame(vertices: np.ndarray, faces: np.ndarray) -> HeadModel:
    random = np.random.default_rng(1)
    shapedirs = np.zeros((FLAME_COUNTS[0], 3, 400), np.float32)
    shapedirs[:, :, [0, 1, 300]] = 0.002 * random.normal(size=(FLAME_COUNTS[0], 3, 3))
    return HeadModel(
        v_template=vertices.astype(np.float32),
        faces=faces.astype(np.int32),
        shapedirs=shapedirs,
        posedirs=(1e-3 * random.normal(size=(FLAME_COUNTS[0], 3, 36))).astype(np.float32),
        joint_regressor=np.full((5, FLAME_COUNTS[0]), 1 / FLAME_COUNTS[0], np.float32),
        weights=random.dirichlet(np.ones(5), FLAME_COUNTS[0]).astype(np.float32),
        parents=np.array([-1, 0, 1, 1, 1]),
        regions={"scalp": np.array([0])},
    )


VERTICES, FACES = head()
LIPS = with_lips(VERTICES)


def row(name: str, lips: np.ndarray, natural: np.ndarray | None = None) -> np.ndarray:
    return teeth_vertices(lips, natural)[15 * ROWS.index(name) :][:15]


def test_the_strips_are_two_surfaces_with_one_outside_each():
    faces = teeth_faces()
    assert faces.shape == (168, 3)
    assert len(np.unique(components(faces, 120))) == 2
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    assert len(np.unique(edges, axis=0)) == len(edges)  # neighbours agree
    _, count = np.unique(np.sort(edges, axis=1), axis=0, return_counts=True)
    assert (count == 1).sum() == 2 * (2 * 14 + 2 * 3)  # each jaw: its roots in front and behind, and its two ends
    np.testing.assert_array_equal(faces[133], [101, 116, 115])
    a, b, c = teeth_vertices(LIPS)[faces.T]
    normals = np.cross(b - a, c - a)
    strips = {name: slice(28 * i, 28 * i + 28) for i, name in enumerate(("front", "back", "bottom"))}
    for first, edge_side in ((0, -1), (84, 1)):
        assert (normals[first:][strips["front"]][:, 2] > 0).all()
        assert (normals[first:][strips["back"]][:, 2] < 0).all()
        assert (edge_side * normals[first:][strips["bottom"]][:, 1] > 0).all()


def test_teeth_stand_behind_the_lips_in_proportion():
    """Upper teeth twice the lips' distance long, a fifth of it between the jaws, the arch as wide as the lips."""
    unit = np.linalg.norm(LIPS[list(UPPER_LIP)] - LIPS[list(LOWER_LIP)], axis=1).mean()
    assert row("upper_root", LIPS)[:, 1] - row("upper_edge", LIPS)[:, 1] == pytest.approx(2 * unit)
    assert row("upper_edge", LIPS)[:, 1] - row("lower_edge", LIPS)[:, 1] == pytest.approx(0.2 * unit)
    assert row("upper_edge", LIPS)[:, 2] - row("upper_edge_back", LIPS)[:, 2] == pytest.approx(unit)
    np.testing.assert_allclose(row("upper_edge", LIPS)[:, 0], LIPS[list(UPPER_LIP), 0], atol=1e-12)
    assert (row("upper_edge", LIPS)[:, 2] < LIPS[list(UPPER_LIP), 2]).all()


@given(st.floats(0.5, 2), st.tuples(*[st.floats(-1, 1)] * 3))
def test_teeth_scale_and_move_with_the_head(scale, shift):
    moved = scale * LIPS + np.array(shift)
    for natural in (None, LIPS):
        np.testing.assert_allclose(
            teeth_vertices(moved, natural), scale * teeth_vertices(LIPS) + np.array(shift), atol=1e-12
        )


def test_swollen_lips_move_teeth_and_do_not_lengthen_them():
    swollen = LIPS.copy()
    swollen[list(UPPER_LIP)] += [0, 0.004, 0.003]
    swollen[list(LOWER_LIP)] += [0, -0.004, 0.003]
    np.testing.assert_allclose(
        teeth_vertices(swollen, LIPS), teeth_vertices(LIPS) + np.array([0, 0, 0.003]), atol=1e-12
    )
    assert np.ptp(teeth_vertices(swollen)[:, 1]) > 1.5 * np.ptp(
        teeth_vertices(LIPS)[:, 1]
    )  # without the natural proportions


def test_teeth_move_with_skull_and_jaw_and_not_with_expressions():
    model = flame(LIPS, FACES).with_teeth()
    assert (len(model.v_template), len(model.faces)) == FLAME_WITH_TEETH_COUNTS
    assert model.with_teeth() is model
    upper, lower = model.regions["teeth_upper"], model.regions["teeth_lower"]
    np.testing.assert_array_equal(np.sort([*upper, *lower]), model.regions["teeth"])
    assert model.v_template[upper, 1].min() > model.v_template[lower, 1].max()
    still = pose(model, HeadParameters())
    smiling = pose(model, HeadParameters(expression=np.eye(100)[0]))
    np.testing.assert_allclose(smiling[FLAME_COUNTS[0] :], still[FLAME_COUNTS[0] :], atol=1e-9)
    assert np.abs(smiling - still).max() > 1e-3
    opened = pose(model, HeadParameters(joints=flame_joints(jaw=[0.3, 0, 0])))
    np.testing.assert_allclose(opened[upper], still[upper], atol=1e-9)
    before, after = (x[lower] - x[lower].mean(axis=0) for x in (still, opened))
    np.testing.assert_allclose(after @ after.T, before @ before.T, atol=1e-9)  # rigid
    assert np.abs(opened[lower] - still[lower]).max() > 1e-3


def test_identity_moves_teeth_as_it_moves_the_lips():
    model = flame(LIPS, FACES).with_teeth()
    person = HeadParameters(shape=np.eye(300)[0])
    lips = (model.shapedirs[list(UPPER_LIP), :, 0] + model.shapedirs[list(LOWER_LIP), :, 0]) / 2
    moved = (neutral(model, person) - neutral(model, HeadParameters()))[FLAME_COUNTS[0] :]
    np.testing.assert_allclose(moved.reshape(8, 15, 3), np.broadcast_to(lips, (8, 15, 3)), atol=1e-6)


def test_loading_adds_teeth_to_models_and_offsets(tmp_path):
    bare = flame(LIPS, FACES)
    bare.save(tmp_path / "flame.npz")
    model = HeadModel.load(tmp_path / "flame.npz")
    assert len(model.v_template) == FLAME_WITH_TEETH_COUNTS[0]
    HeadParameters(static_offset=np.full((FLAME_COUNTS[0], 3), 0.01)).save(tmp_path / "00000.npz", bare)
    offset = HeadParameters.load(tmp_path / "00000.npz", model).static_offset
    assert offset[: FLAME_COUNTS[0]] == pytest.approx(0.01)
    assert not offset[FLAME_COUNTS[0] :].any()


def test_a_path_gets_teeth_at_its_nodes_and_loses_them():
    model = flame(LIPS, FACES).with_teeth()
    whole = model.v_template.astype(np.float64)
    displacement = 0.1 * LIPS + 0.002 * np.random.default_rng(2).normal(size=LIPS.shape)
    bare = replace(
        straight_path(LIPS, FACES, displacement, 0.25),
        columns=np.array([0]), changes=np.ones((1, 1, FLAME_COUNTS[0], 3), np.float32),
    )  # fmt: skip
    path = add_teeth(bare, whole, model.faces)
    built = teeth_vertices(LIPS) + path.displacement(0.25)[FLAME_COUNTS[0] :]
    np.testing.assert_allclose(built, teeth_vertices(LIPS + displacement, LIPS), atol=1e-7)
    assert not path.at(0.0).displacement.any()
    assert not path.at(0.25).blendshape_change(np.ones(1))[FLAME_COUNTS[0] :].any()
    again = without_teeth(path)
    np.testing.assert_array_equal(again.displacements, bare.displacements)
    np.testing.assert_array_equal(again.changes, bare.changes)
    np.testing.assert_array_equal(again.faces, bare.faces)


def test_the_stage_excludes_teeth_from_the_equation(tmp_path):
    """The skin moves as without teeth; teeth are added to a sculpture without them."""
    flame(VERTICES, FACES).save(tmp_path / "flame.npz")
    model = HeadModel.load(tmp_path / "flame.npz")
    HeadParameters(expression=np.eye(100)[0]).save(tmp_path / "00000.npz", model)
    frame = Frame(0, 0, "EXP-2", "test", "0.png", "0_mask.png", "00000.npz", 0)
    cameras = (Camera(np.eye(4), 9.0, 9.0, 4.0, 4.0, 8, 8),)
    Capture(tmp_path, tmp_path / "flame.npz", (frame,), cameras, 1.0).save(tmp_path / "capture.json")
    files = {"capture": tmp_path / "capture.json", "path": tmp_path / "path.npz"}

    settings = Exaggerate(limit_cavities=False)
    exaggerate(settings, **files)
    path, vertices = GammaPath.load(tmp_path / "path.npz"), model.v_template.astype(np.float64)
    assert skin_counts(len(path.neutral), len(path.faces)) == FLAME_COUNTS
    alone = Exaggerator(vertices[: FLAME_COUNTS[0]], FACES, settings).solve(0.25)
    np.testing.assert_allclose(path.displacement(0.25)[: FLAME_COUNTS[0]], alone, atol=1e-6)
    assert path.at(0.25).blendshape_change(np.eye(100)[0]).any()

    np.savez(tmp_path / "sculpt.npz", delta=np.full((FLAME_COUNTS[0], 3), 0.01))
    exaggerate(Exaggerate(file=str(tmp_path / "sculpt.npz")), **files)
    path = GammaPath.load(tmp_path / "path.npz")
    np.testing.assert_allclose(path.displacement(0.25), 0.01, atol=1e-6)
