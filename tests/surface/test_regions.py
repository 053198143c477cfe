"""A face belongs to a region iff its three corners do."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from surface.test_operators import sphere

from carigs.surface.regions import face_region


@given(st.sets(st.integers(0, 41)))
def test_a_face_needs_all_its_corners(chosen):
    vertices, faces = sphere(1)
    inside = face_region(faces, np.array(sorted(chosen), int), len(vertices))
    assert [bool(i) for i in inside] == [set(map(int, face)) <= chosen for face in faces]
