"""The source of the curvature (subject, template, ratio), and regions with levels of their own."""

from dataclasses import replace

import numpy as np
import pytest
from miniature import ball_model

from carigs.errors import SettingsError
from carigs.exaggeration import Exaggerator
from carigs.head import subject_exaggerator, subject_gamma_path
from carigs.mesh.triangle_mesh import diagonal
from carigs.settings import Exaggerate

PLAIN = Exaggerate(limit_cavities=False, gap_stiffness=0.0)
MODEL = ball_model()
MEAN = MODEL.v_template.astype(np.float64)
DENT = np.exp(-((MEAN - [0, 0, 0.1]) ** 2).sum(axis=1) / 0.04**2)
SUBJECT = MEAN * (1 + 0.15 * DENT[:, None])


def test_the_template_gives_every_subject_the_same_displacement():
    """As in the paper: the displacement of the template is added to the subject."""
    path = subject_gamma_path(MODEL, SUBJECT, replace(PLAIN, curvature_source="template"))
    np.testing.assert_array_equal(path.neutral, SUBJECT)
    expected = Exaggerator(MEAN, MODEL.faces, PLAIN).solve(0.25)
    np.testing.assert_allclose(path.displacement(0.25), expected, atol=1e-6)
    own = subject_gamma_path(MODEL, SUBJECT, PLAIN).displacement(0.25)
    assert np.abs(own - expected).max() > 1e-3


@pytest.mark.parametrize("scale", [1.0, 3.0])
def test_the_mean_face_of_any_size_does_not_change(scale):
    settings = replace(PLAIN, curvature_source="ratio")
    np.testing.assert_allclose(subject_exaggerator(MODEL, scale * MEAN, settings).solve(0.5), 0, atol=1e-9)


def test_only_differences_from_the_mean_face_grow():
    """The subject differs from the mean in a bump: the weights differ from 1 there and nowhere else."""
    # Without the division by the mean and by each face's K_ref, which act everywhere.
    solver = subject_exaggerator(MODEL, SUBJECT, replace(PLAIN, curvature_source="ratio", curvature_smoothing=0.0))
    far = DENT < 1e-4
    spread = solver.log_curvature[far].std() / solver.log_curvature.std()
    assert spread < 0.2
    bump = Exaggerator(SUBJECT, MODEL.faces, PLAIN).log_curvature
    assert bump[far].std() / bump.std() > 0.5


def test_a_mean_face_of_the_same_vertices_is_required():
    settings = replace(PLAIN, curvature_source="ratio")
    for mean in (None, MEAN[:-1]):
        with pytest.raises(SettingsError, match=r"curvature_source=ratio needs a mean face"):
            Exaggerator(SUBJECT, MODEL.faces, settings, mean_face=mean)


def test_regions_of_the_model_have_levels_of_their_own():
    """At the path's end the region has its level, and half way half of it."""
    settings = replace(PLAIN, gamma=0.2, regions={"face": 0.4, "scalp": 0.0})
    path, solver = subject_gamma_path(MODEL, SUBJECT, settings), subject_exaggerator(MODEL, SUBJECT, settings)
    for share in (0.5, 1.0):
        expected = solver.solve(share * 0.2, {"face": share * 0.4, "scalp": 0.0})
        assert np.linalg.norm(path.displacement(share * 0.2) - expected, axis=1).max() < 2e-4 * diagonal(SUBJECT)
    with pytest.raises(SettingsError, match="region nose is unknown; known: face, neck, scalp"):
        subject_gamma_path(MODEL, SUBJECT, replace(settings, regions={"nose": 0.4}))
