"""The robust preset on real heads: no face turns over, nothing grows through anything else, eyes stay in."""

import os
from pathlib import Path

import igl
import numpy as np
import pytest
import trimesh
from igl.copyleft.cgal import remesh_self_intersections
from scipy.spatial.transform import Rotation

from carigs.settings import Exaggerate
from carigs.surface import Exaggerator
from carigs.surface.mesh import diagonal, face_normals

DATA = Path(os.environ.get("CARIGS_DATA", Path(__file__).parents[2] / "../shared/data"))
pytestmark = pytest.mark.skipif(not DATA.is_dir(), reason="the shared meshes are not here; set CARIGS_DATA")
GIVEN = (
    "ict_head_eyes_neutral",
    "ict_head_id0",
    "ict_head_id0_5042",
    "ict_head_neutral",
    "makehuman_head_eyes_female",
    "mediapipe_canonical_face_model",
)


def read(name: str) -> tuple[np.ndarray, np.ndarray]:
    mesh = trimesh.load(DATA / f"meshes/{name}.obj", process=False, maintain_order=True)
    return np.asarray(mesh.vertices), np.asarray(mesh.faces)


def random_person(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """The model's identity directions are in standard deviations."""
    with np.load(DATA / "ict_model.npz") as model:
        directions = model["shapedirs"][:, :, :30].astype(float)
        code = np.random.default_rng(seed).normal(size=30)
        return model["v_template"] + directions @ code, model["f"].astype(np.int64)


def cut_faces(vertices: np.ndarray, faces: np.ndarray) -> set[int]:
    """Faces that cut others, exactly (CGAL's predicates)."""
    pairs = remesh_self_intersections(vertices, np.asarray(faces, np.int64), detect_only=True)[2]
    return set(pairs.ravel().tolist())


def depth_in_balls(vertices: np.ndarray, solver: Exaggerator) -> list[float]:
    """How deep the skin reaches into each small component, in its radii."""
    depths = []
    for c in np.setdiff1d(solver.component, [solver.main]):
        inside = solver.component == c
        centre = vertices[inside].mean(axis=0)
        radius = np.linalg.norm(vertices[inside] - centre, axis=1).max()
        skin = vertices[solver.solved & (np.linalg.norm(vertices - centre, axis=1) < 1.3 * radius)]
        ball = np.asarray(solver.faces[inside[solver.faces].all(axis=1)])
        depths.append(-igl.signed_distance(skin, vertices, ball)[0].min() / radius)
    return depths


def check(solver: Exaggerator) -> None:
    vertices, faces = solver.vertices, solver.faces
    moved = vertices + solver.solve(0.25)
    assert ((face_normals(vertices, faces) * face_normals(moved, faces)).sum(axis=1) > 0).all()
    skin = faces[solver.solved[faces].all(axis=1)]
    newly = cut_faces(moved, skin) - cut_faces(vertices, skin)
    assert len(newly) <= 1e-3 * len(skin)
    for before, after in zip(depth_in_balls(vertices, solver), depth_in_balls(moved, solver), strict=True):
        assert after < before + 0.03
    assert np.linalg.norm(moved - vertices, axis=1).max() > 0.03 * diagonal(vertices)


@pytest.mark.parametrize("name", GIVEN)
def test_given_heads_stay_heads(name):
    solver = Exaggerator(*read(name))
    check(solver)
    path, extent = solver.path(0.25), diagonal(solver.vertices)
    for level in np.linspace(0.02, 0.24, 5):
        error = np.linalg.norm(path.displacement(level) - solver.solve(level), axis=1).max()
        assert error < 1e-4 * extent


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_random_people_stay_heads(seed):
    check(Exaggerator(*random_person(seed)))


def test_unit_place_turn_and_numbering_do_not_matter_to_the_robust_preset():
    """With what the surface sees of itself: occlusion and gaps."""
    vertices, faces = read("makehuman_head_eyes_female")
    extent, random = diagonal(vertices), np.random.default_rng(0)
    # On a grid that coordinates far away still have, so that only the method is tested, not the numbers' rounding.
    grid = 2.0 ** np.round(np.log2(1e6 * extent)) * 2.0**-50
    vertices = np.round(vertices / grid) * grid
    shift = np.round(np.array([0.6, -0.64, 0.48]) * 1e6 * extent / grid) * grid
    expected = Exaggerator(vertices, faces).solve(0.25)

    def same(displacement: np.ndarray) -> None:
        np.testing.assert_allclose(displacement, expected, atol=1e-9 * extent)

    for unit in (1e-6, 1e6):
        same(Exaggerator(unit * vertices, faces).solve(0.25) / unit)
    same(Exaggerator(vertices + shift, faces).solve(0.25))
    turn = Rotation.from_rotvec([0.5, -2.0, 1.0]).as_matrix()
    same(Exaggerator(vertices @ turn.T, faces).solve(0.25) @ turn)
    order = random.permutation(len(vertices))
    shuffled = np.argsort(order)[faces][random.permutation(len(faces))]
    back = np.empty_like(expected)
    back[order] = Exaggerator(vertices[order], shuffled).solve(0.25)
    same(back)


@pytest.mark.parametrize(("mode", "outside"), [("soft", 1e-3), ("exact", 0.0)])
def test_a_nose_on_a_real_head_has_no_border(mode, outside):
    """Across the ramp's end, neighbouring faces turn against each other by at most 3 degrees (95 %)."""
    vertices, faces = read("ict_head_id0")  # the skin of the model below, vertex for vertex
    with np.load(DATA / "ict_model.npz") as model:
        nose = model["mask_nose"]
    edit = Exaggerator(vertices, faces, Exaggerate(local=mode), regions={"nose": nose}).local("nose")
    moved = vertices + edit.solve(0.25)
    change = np.linalg.norm(moved - vertices, axis=1) / diagonal(vertices)
    assert change[edit.field == 0].max() <= outside
    assert change.max() > 0.02
    edges, _, sides = igl.edge_topology(vertices, np.asarray(faces, np.int64))
    border = (sides >= 0).all(axis=1) & ((edit.field[edges] > 0).sum(axis=1) == 1)

    def bend(v: np.ndarray) -> np.ndarray:
        a, b = face_normals(v, faces)[sides[border].T]
        return np.degrees(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1)))

    assert np.percentile(np.abs(bend(moved) - bend(vertices)), 95) <= 3.0
