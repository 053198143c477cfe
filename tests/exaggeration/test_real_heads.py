"""The robust preset on real heads: no face turns over, nothing grows through anything else, eyes stay in."""

import csv
import os
from pathlib import Path

import numpy as np
import pytest
from surfaces import sphere

from carigs.exaggeration import Exaggerator
from carigs.head import HeadModel
from evaluation.benchmarks.surface import read_heads
from evaluation.benchmarks.surface_accuracy import random_person
from evaluation.stress import heads
from evaluation.stress.heads import (
    check,
    dihedral_angles,
    intersecting_faces,
    invariance_checks,
    region_checks,
    shape_checks,
)

DATA = Path(os.environ.get("CARIGS_DATA", Path(__file__).parents[2] / "../shared/data"))
real = pytest.mark.skipif(not DATA.is_dir(), reason="the shared meshes are not here; set CARIGS_DATA")
GIVEN = (
    "ict_head_eyes_neutral",
    "ict_head_id0",
    "ict_head_id0_5042",
    "ict_head_neutral",
    "makehuman_head_eyes_female",
    "mediapipe_canonical_face_model",
)


def read(name: str) -> tuple[np.ndarray, np.ndarray]:
    return read_heads([DATA / f"meshes/{name}.obj"])[name]


def hold(checks) -> None:
    found = list(checks)
    assert found
    assert [check for check in found if not check.holds] == []


@real
@pytest.mark.parametrize("name", GIVEN)
def test_given_heads_stay_heads(name):
    solver = Exaggerator(*read(name))
    hold(shape_checks(name, solver))
    assert np.linalg.norm(solver.solve(0.25), axis=1).max() > 0.03 * np.linalg.norm(np.ptp(solver.vertices, axis=0))


@real
@pytest.mark.slow
@pytest.mark.parametrize("seed", range(20))
def test_random_people_stay_heads(seed):
    model = HeadModel.load(DATA / "ict_model.npz")
    hold(shape_checks(f"person {seed}", Exaggerator(random_person(model, seed), model.faces)))


@real
def test_unit_place_turn_and_numbering_do_not_matter_to_the_robust_preset():
    """With what the surface sees of itself: occlusion and gaps."""
    hold(invariance_checks("head", *read("makehuman_head_eyes_female")))


@real
def test_a_nose_on_a_real_head_has_no_border():
    """Across the ramp's end, neighbouring faces turn against each other by at most 3 degrees (95 %)."""
    model, (vertices, faces) = HeadModel.load(DATA / "ict_model.npz"), read("ict_head_id0")
    # The head is the skin of the model, vertex for vertex.
    hold(region_checks("nose", vertices, faces, model.regions["nose"]))


@real
@pytest.mark.parametrize(("gamma", "failed"), [(0.25, False), (2.0, True)])
def test_the_table_tells_what_does_not_hold(tmp_path, monkeypatch, gamma, failed):
    """A head that is exaggerated far beyond what it is made for turns faces over."""
    monkeypatch.setattr(heads, "GAMMA", gamma)
    mesh = DATA / "meshes/mediapipe_canonical_face_model.obj"
    monkeypatch.setattr("sys.argv", ["heads", str(tmp_path / "heads.csv"), str(mesh)])
    assert heads.main() == failed
    with (tmp_path / "heads.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert {row["case"] for row in rows} == {mesh.stem}
    (turned,) = (row for row in rows if row["what"].startswith("faces turned"))
    assert turned["holds"] == str(not failed)
    assert any(row["holds"] == "False" for row in rows) == failed


def test_faces_that_cut_others_are_found():
    """Two balls: apart, and one with its centre on the other's surface."""
    ball, faces = sphere(2)
    both = np.vstack([faces, faces + len(ball)])
    assert intersecting_faces(np.vstack([ball, ball + 3.0]), both) == set()
    cut = intersecting_faces(np.vstack([ball, ball + np.array([1.0, 0, 0])]), both)
    middles = ball[faces].mean(axis=1)
    # The circle of the cut lies in the plane x = 1/2.
    assert max(abs(middles[f % len(faces), 0] + (f >= len(faces)) - 0.5) for f in cut) < 0.3
    assert len({f for f in cut if f < len(faces)}) > 20


@pytest.mark.parametrize("angle", [0.0, 30.0, 170.0])
def test_bends_are_the_angles_between_faces(angle):
    turn = np.radians(angle)
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0, -1, 0], [0, np.cos(turn), np.sin(turn)]])
    assert dihedral_angles(vertices, np.array([[0, 2, 1], [0, 1, 3]]), np.array([[0, 1]]))[0] == pytest.approx(
        angle, abs=1e-5
    )


def test_what_is_no_number_does_not_hold():
    assert not check("a", "b", float("nan"), 1.0).holds
    assert not check("a", "b", 1.1, 1.0).holds
    assert check("a", "b", 1.0, 1.0).holds
