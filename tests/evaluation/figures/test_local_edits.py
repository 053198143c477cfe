"""Renderings with one region exaggerated at a time."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from surfaces import PLAIN, bumpy

from carigs.exaggeration import Exaggerator, GammaPath
from evaluation.figures.local_edits import REGIONS, local_edits

VERTICES, FACES = bumpy(3)
NOSE = np.flatnonzero(VERTICES[:, 2] > 0.9 * VERTICES[:, 2].max())
LEFT, RIGHT = (np.flatnonzero(side * VERTICES[:, 0] > 0.9 * VERTICES[:, 0].max()) for side in (1, -1))
LEVEL = 0.25


@dataclass
class Sequence:
    path: GammaPath


@dataclass
class Displacements:
    """An avatar whose picture is the displacement of every vertex."""

    sequence: Sequence

    def render(self, timestep, level, camera):
        return self.sequence.path.displacement(level)[None] if level else np.zeros((1, *VERTICES.shape))


@pytest.fixture(scope="module")
def exaggerator():
    regions = {"nose": NOSE, "left_ear": LEFT, "right_ear": RIGHT}
    return Exaggerator(VERTICES, FACES, replace(PLAIN, region_constraint="exact"), regions=regions)


def test_a_region_moves_alone(exaggerator):
    whole = exaggerator.path(LEVEL)
    edits = local_edits(Displacements(Sequence(whole)), exaggerator, LEVEL, 3, [None, None])
    assert list(edits) == ["none", "nose", "ears", "all"] and {len(views) for views in edits.values()} == {2}
    moved = {name: np.linalg.norm(views[0][0], axis=1) > 0 for name, views in edits.items()}
    assert not moved["none"].any() and moved["all"].all()
    np.testing.assert_array_equal(edits["all"][0][0], whole.displacement(LEVEL))
    assert moved["nose"][NOSE].all() and not moved["nose"][[*LEFT, *RIGHT]].any()
    assert moved["ears"][[*LEFT, *RIGHT]].all() and not moved["ears"][NOSE].any()


def test_regions_that_the_model_lacks_are_left_out():
    plain = Exaggerator(VERTICES, FACES, PLAIN)
    edits = local_edits(Displacements(Sequence(plain.path(LEVEL))), plain, LEVEL, 0, [None])
    assert list(edits) == ["none", "all"] and not {*REGIONS} & {*edits}
