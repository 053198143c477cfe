"""People are told from each other by the colours at their landmarks, under any brightness and white balance."""

import cv2
import numpy as np
import pytest

from carigs.detection.likeness import SAME, Acquaintance, differences, face_colours
from carigs.detection.mesh_indices import COUNT

POINTS = np.random.default_rng(0).uniform(30, 160, (COUNT, 2))


def face(seed, noise=0.0):
    """Soft spots of colour on skin."""
    rng = np.random.default_rng(seed)
    spots = cv2.resize(rng.uniform(40, 220, (6, 6, 3)), (192, 192), interpolation=cv2.INTER_CUBIC)
    return (spots + noise * np.random.default_rng(9).normal(size=spots.shape)).clip(0, 255).astype(np.uint8)


def difference(first, second):
    return differences(face_colours(first, POINTS)[None], face_colours(second, POINTS)[None]).item()


@pytest.mark.parametrize("gain", [(0.5, 0.5, 0.5), (1.0, 0.8, 0.6)])
def test_light_and_noise_change_a_face_less_than_another_person(gain):
    assert difference(face(1), (face(1, noise=8) * gain).astype(np.uint8)) < 0.2 * SAME
    assert difference(face(1), face(2)) > 2 * SAME


def test_a_face_without_contrast_is_nobody():
    assert difference(np.full((192, 192, 3), 90, np.uint8), face(1)) == pytest.approx(1)


def test_a_person_is_recognised_after_a_slow_change_and_not_after_a_sudden_one():
    views = [face_colours(cv2.addWeighted(face(1), 1 - t, face(2), t, 0), POINTS) for t in np.linspace(0, 1, 12)]
    slow, sudden = Acquaintance(), Acquaintance()
    assert all(slow.recognises(view) for view in views)
    assert slow.recognises(views[0])  # and as the person was at first
    assert sudden.recognises(views[0]) and not sudden.recognises(views[-1]) and sudden.recognises(views[0])
