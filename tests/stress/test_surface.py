"""Broken meshes: every known case holds, and any other mesh is repaired or refused with a named element."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from carigs.errors import MeshError
from carigs.exaggeration import Exaggerator
from carigs.mesh import check_mesh, clean_mesh
from stress.case import examine
from stress.surface import DAMAGES, SETTINGS, cases, sound_mesh

VERTICES, FACES = sound_mesh()
EXPECTED = Exaggerator(VERTICES, FACES, SETTINGS).solve(0.25)
MENDED = {damage.name: damage.change for damage in DAMAGES if damage.tolerance is not None and damage.tolerance < 1e-6}


def test_no_case_is_wrong():
    results = [examine("surface", case) for case in cases(VERTICES, FACES)]
    assert [result for result in results if not result.holds] == []
    assert len(results) == len(DAMAGES)


@pytest.mark.parametrize(
    ("case", "named"),
    [
        ("a fin", f"edge {min(FACES[40, :2])}-{max(FACES[40, :2])}"),
        ("nan", "vertex 9"),
        ("inf", "vertex 9"),
        ("a corner that is no vertex", f"face {len(FACES)}"),
    ],
)
def test_what_cannot_be_mended_names_the_element(case, named):
    (damage,) = (d.change for d in DAMAGES if d.name == case)
    with pytest.raises(MeshError, match=named):
        clean_mesh(*damage(VERTICES.copy(), FACES.copy()))


@settings(max_examples=20)
@given(st.lists(st.sampled_from(sorted(MENDED)), min_size=2, max_size=4, unique=True))
def test_faults_may_come_together(names):
    """In any order: the sound mesh's caricature to 1e-9."""
    vertices, faces = VERTICES.copy(), FACES.copy()
    for name in names:
        vertices, faces = MENDED[name](vertices, faces)
    clean = clean_mesh(vertices, faces)
    moved = clean.to_input(Exaggerator(clean.vertices, clean.faces, SETTINGS).solve(0.25))
    used = np.intersect1d(faces, np.arange(len(VERTICES)))
    np.testing.assert_allclose(moved[used], EXPECTED[used], atol=1e-9)


coordinates = st.sampled_from([0.0, 1.0, -1.0, 0.5, 1e-9, 1e-300, 1e150, -3e7, float("nan"), float("inf")])


@settings(max_examples=300)
@given(st.lists(st.tuples(*[coordinates] * 3), max_size=8), st.lists(st.tuples(*[st.integers(-1, 8)] * 3), max_size=12))
def test_anything_is_mended_or_named(vertices, faces):
    """No other exception than `MeshError`, no number that is not finite."""
    vertices, faces = np.array(vertices).reshape(-1, 3), np.array(faces, int).reshape(-1, 3)
    try:
        clean = clean_mesh(vertices, faces)
    except MeshError:
        return
    check_mesh(clean.vertices, clean.faces)
    try:
        moved = clean.to_input(Exaggerator(clean.vertices, clean.faces, SETTINGS).solve(0.25))
    except MeshError:
        return
    assert np.isfinite(moved).all()
