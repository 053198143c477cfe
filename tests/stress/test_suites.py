"""The stress suites: no case is wrong, and a defect in what they test makes cases wrong."""

import numpy as np
import pytest

from stress import metrics, posing, raster, rasterizer, rig, surfel_gradients, targets
from stress.case import examine

SUITES = {module.__name__.split(".")[-1]: module for module in (raster, targets, rig, rasterizer, metrics)}


def wrong(suite: str, part: str = "") -> list:
    """Outcomes of the cases that are wrong, of those with `part` in their names."""
    chosen = [case for case in SUITES[suite].cases() if part in case.name]
    assert chosen
    return [outcome for outcome in (examine(suite, case) for case in chosen) if not outcome.holds]


@pytest.mark.slow
@pytest.mark.parametrize("suite", SUITES)
def test_no_case_is_wrong(suite):
    assert wrong(suite) == []


def test_cases_have_names_of_their_own_and_are_more_than_five_hundred():
    names = [(suite, case.name) for suite, module in SUITES.items() for case in module.cases()]
    assert len(set(names)) == len(names) > 500


def without_flags(*arguments, **options):
    warp = targets_warp(*arguments, **options)
    warp.mask_flags[:] = 0
    return warp


targets_warp, rig_motion, raster_view = targets.warp_frame, rig.face_motion, raster.compute_visibility
rotations, score, similarity = posing.rotation_matrices, metrics.clip_d, metrics.ssim_map


def with_left_handed_rotations(*arguments):
    motion = rig_motion(*arguments)
    motion.rotation[:] *= -1
    return motion


def seen_from_half_a_pixel_off(vertices, faces, camera):
    seen = raster_view(vertices, faces, camera)
    seen.face[:] = np.roll(seen.face, 1, axis=1)
    return seen


@pytest.mark.parametrize(
    ("suite", "part", "module", "function", "defect"),
    [
        ("raster", "ball, close by, 8 x 16", raster, "compute_visibility", seen_from_half_a_pixel_off),
        ("targets", "sheet: mirrored", targets, "warp_frame", without_flags),
        ("rig", "sheared, unit 1", rig, "face_motion", with_left_handed_rotations),
        ("rig", "rotation by 1 about", posing, "rotation_matrices", lambda vector: rotations(-vector)),
        ("metrics", "grey and noise, 5 x 5", metrics, "ssim_map", lambda image, truth: similarity(image, truth[::-1])),
        ("metrics", "zero embeddings", metrics, "clip_d", lambda *vectors: score(*vectors) / 0.0),
    ],
)
def test_a_planted_defect_makes_cases_wrong(suite, part, module, function, defect, monkeypatch):
    assert wrong(suite, part) == []
    monkeypatch.setattr(module, function, defect)
    assert wrong(suite, part)


@pytest.mark.slow
def test_a_defect_in_the_gradient_of_surfels_makes_cases_wrong(monkeypatch):
    """The gradient of the opacity lacks a factor."""

    def drawn(*arguments, **options):
        images, gradients = true(*arguments, **options)
        gradients[3] *= 0.99
        return surfel_gradients.Drawn(images, gradients)

    true = surfel_gradients.measured
    assert wrong("rasterizer", "far among others, 0") == []
    monkeypatch.setattr(surfel_gradients, "measured", drawn)
    assert wrong("rasterizer", "far among others, 0")
