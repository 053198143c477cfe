"""The preset `robust` on real heads: no face is inverted, surfaces do not intersect, eyeballs stay in their sockets."""

import csv

import numpy as np
import pytest
from shared_data import DATA, needs_data
from stress import heads
from stress.heads import (
    check,
    dihedral_angles,
    intersecting_faces,
    invariance_checks,
    region_checks,
    shape_checks,
)
from surfaces import sphere

from carigs.exaggeration import Exaggerator
from carigs.head import HeadModel
from evaluation.benchmarks.exaggeration.surface_accuracy import random_person
from evaluation.benchmarks.surface import read_heads

HEADS = (
    "ict_head_eyes_neutral",
    "ict_head_id0",
    "ict_head_id0_5042",
    "ict_head_neutral",
    "makehuman_head_eyes_female",
    "mediapipe_canonical_face_model",
)


def read(name: str) -> tuple[np.ndarray, np.ndarray]:
    return read_heads([DATA / f"meshes/{name}.obj"])[name]


def assert_hold(checks) -> None:
    checks = list(checks)
    assert checks
    assert [check for check in checks if not check.holds] == []


@pytest.mark.sample(1)
@needs_data
@pytest.mark.parametrize("name", HEADS)
def test_shared_heads_pass_the_shape_checks(name):
    solver = Exaggerator(*read(name))
    assert_hold(shape_checks(name, solver))
    assert np.linalg.norm(solver.solve(0.25), axis=1).max() > 0.03 * np.linalg.norm(np.ptp(solver.vertices, axis=0))


@needs_data
@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_random_people_pass_the_shape_checks(seed):
    model = HeadModel.load(DATA / "ict_model.npz")
    assert_hold(shape_checks(f"person {seed}", Exaggerator(random_person(model, seed), model.faces)))


@pytest.mark.slow
@needs_data
def test_the_robust_preset_is_invariant_to_unit_translation_rotation_and_numbering():
    """Including ambient occlusion and gaps."""
    assert_hold(invariance_checks("head", *read("makehuman_head_eyes_female")))


@needs_data
def test_a_local_edit_of_the_nose_has_no_crease():
    """Across the ramp's end, the angle between neighbouring faces changes by at most 3 degrees (95 %)."""
    model, (vertices, faces) = HeadModel.load(DATA / "ict_model.npz"), read("ict_head_id0")
    # The vertices of the head are those of the model's skin.
    assert_hold(region_checks("nose", vertices, faces, model.regions["nose"]))


@needs_data
@pytest.mark.parametrize(("gamma", "failed"), [(0.25, False), (2.0, True)])
def test_the_table_marks_checks_that_do_not_hold(tmp_path, monkeypatch, gamma, failed):
    """An exaggeration far beyond the intended levels inverts faces."""
    monkeypatch.setattr(heads, "GAMMA", gamma)
    mesh = DATA / "meshes/mediapipe_canonical_face_model.obj"
    monkeypatch.setattr("sys.argv", ["heads", str(tmp_path / "heads.csv"), str(mesh)])
    assert heads.main() == failed
    with (tmp_path / "heads.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert {row["case"] for row in rows} == {mesh.stem}
    (turned,) = (row for row in rows if row["detail"].startswith("faces turned"))
    assert (turned["outcome"] == "wrong") == failed
    assert any(row["outcome"] == "wrong" for row in rows) == failed


def test_intersecting_faces_are_found():
    """Two balls: apart, and one with its centre on the other's surface."""
    ball, faces = sphere(2)
    both = np.vstack([faces, faces + len(ball)])
    assert intersecting_faces(np.vstack([ball, ball + 3.0]), both) == set()
    cut = intersecting_faces(np.vstack([ball, ball + np.array([1.0, 0, 0])]), both)
    middles = ball[faces].mean(axis=1)
    # The intersection is a circle in the plane x = 1/2.
    assert max(abs(middles[f % len(faces), 0] + (f >= len(faces)) - 0.5) for f in cut) < 0.3
    assert len({f for f in cut if f < len(faces)}) > 20


@pytest.mark.parametrize("angle", [0.0, 30.0, 170.0])
def test_bends_are_the_angles_between_faces(angle):
    turn = np.radians(angle)
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, -1, 0], [0, np.cos(turn), np.sin(turn)]])
    assert dihedral_angles(vertices, np.array([[0, 2, 1], [0, 1, 3]]), np.array([[0, 1]]))[0] == pytest.approx(
        angle, abs=1e-5
    )


def test_nan_does_not_hold():
    assert not check("a", "b", float("nan"), 1.0).holds
    assert not check("a", "b", 1.1, 1.0).holds
    assert check("a", "b", 1.0, 1.0).holds
