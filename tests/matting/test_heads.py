"""Mattes of heads with hair from weak coarse mattes: the error in the band of 10 pixels around the outline."""

import numpy as np
import pytest
from matting.scenes import captured_head, make_scene, toy_head
from shared_data import DATA, needs_data

from carigs.matting import matted_frames
from evaluation.benchmarks.footage.backgrounds import KINDS as BACKGROUNDS

pytestmark = pytest.mark.slow
BAR = 0.08


@pytest.fixture(scope="module")
def toy():
    return toy_head(512, 16)


def mattes(scene):
    return list(matted_frames(scene.frames, lambda frame: scene.coarse[frame.number]))


@pytest.mark.parametrize("kind", BACKGROUNDS)
def test_a_toy_with_long_hair(toy, kind):
    scene = make_scene(*toy, kind)
    found = mattes(scene)
    assert np.mean([scene.error(i, matted.alpha) for i, matted in enumerate(found)]) <= BAR


@needs_data
@pytest.mark.parametrize(("subject", "camera"), [("ict_s1", 3), ("ict_s7", 8)])
def test_a_captured_head_over_all_backgrounds(subject, camera):
    colours, alphas = captured_head(DATA / subject, camera)
    errors = []
    for kind in BACKGROUNDS:
        scene = make_scene(colours[:12], alphas[:12], kind)
        errors.append(np.mean([scene.error(i, matted.alpha) for i, matted in enumerate(mattes(scene))]))
    assert np.mean(errors) <= BAR
