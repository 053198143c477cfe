"""Places of landmarks: no distance from themselves, and a fit that believes wrong places is worse."""

import numpy as np
import pytest

from carigs.capture import read_dataset
from carigs.embedding import register_landmarks
from carigs.head import SurfacePoints
from carigs.settings import Toy
from carigs.toy import head_model, write_capture
from evaluation.benchmarks.footage.landmark_places import distances, face_error

SMALL = Toy(width=104, height=136, cameras=6, steps_per_sequence=1, supersampling=1, texture_size=128, hair_strands=200)


def test_places_have_no_distance_from_themselves(tmp_path):
    model = head_model()
    found = register_landmarks(model)
    found.save(tmp_path / "same.npz")
    rows = {row.quantity: row.value for row in distances(model, tmp_path / "same.npz")}
    assert {"median distance, lips", "median distance, eyes"} <= rows.keys()
    assert max(rows.values()) < 1e-3


@pytest.mark.slow
def test_a_fit_that_believes_other_places_is_worse(tmp_path):
    write_capture(tmp_path / "toy", SMALL)
    capture = read_dataset(tmp_path / "toy", tmp_path / "toy" / "head_model.npz")
    own = capture.model.landmarks68
    points = own.interpolate(capture.model.v_template) + np.array([0, 0.005, 0])
    skin = np.flatnonzero(capture.model.vertex_region("face"))
    apart = np.linalg.norm(capture.model.v_template[skin] - points[:, None], axis=2)
    above = SurfacePoints.at_vertices(skin[apart.argmin(axis=1)])
    right, wrong = (face_error(capture, own, believed) for believed in (own, above))
    assert right < 2 < wrong
