"""Colours of skin by those of a face."""

import numpy as np
import pytest

from carigs.tracking.outline.skin_colours import SkinColours

FACES = {"fair": (0.85, 0.65, 0.58), "brown": (0.45, 0.30, 0.22), "dark": (0.28, 0.18, 0.14)}


def face(skin: tuple[float, float, float]) -> np.ndarray:
    """Skin with shading, and a fifth of it eyes, lips and brows."""
    random = np.random.default_rng(0)
    colours = np.array(skin) * random.uniform(0.8, 1.1, (200, 1)) + random.normal(0, 0.01, (200, 3))
    colours[:20], colours[20:40] = 0.08, (0.7, 0.3, 0.35)
    return colours.clip(0, 1)


@pytest.mark.parametrize("skin", FACES)
def test_skin_in_other_light_is_skin(skin):
    light = np.array([[0.6], [0.8], [1.0], [1.15]])
    assert SkinColours(face(FACES[skin])).contains(light * FACES[skin]).all()


@pytest.mark.parametrize("skin", FACES)
@pytest.mark.parametrize("other", [(0.1, 0.09, 0.085), (0.05, 0.05, 0.05), (0.2, 0.3, 0.6), (0.9, 0.9, 0.9)])
def test_black_hair_and_coloured_or_white_clothes_are_not(skin, other):
    assert not SkinColours(face(FACES[skin])).contains(np.array([other])).any()
