"""Cached motions follow what they are computed with."""

from dataclasses import replace

import numpy as np
import pytest
from miniature import ball_model

from carigs.exaggeration.gamma_path import straight_path
from carigs.head import HeadParameters, neutral
from carigs.splat.rig.head_sequence import HeadSequence, subject_sequence
from carigs.splat.rig.smooth_motion import SmoothMotion
from carigs.splat.rig.solid_motion import Solid

MODEL = ball_model()


def new_sequence(stretch: float = 0.3) -> HeadSequence:
    zero = HeadParameters.zeros(MODEL)
    expression = zero.expression.copy()
    expression[0] = 1.5
    rest = neutral(MODEL, zero)
    path = straight_path(rest, MODEL.faces, rest * [stretch, 0, 0], 0.25)
    return subject_sequence(MODEL, {0: replace(zero, expression=expression)}, path)


def add_solids(sequence):
    low = MODEL.v_template[MODEL.faces].mean(axis=1)[:, 1] < -0.02
    sequence.add_solids(np.where(low, Solid.LOWER_JAW, Solid.NONE).astype(np.uint8))


def smooth(sequence):
    scalp = MODEL.face_region("scalp", "face")
    sequence.smooth = SmoothMotion(sequence.rig, scalp, True, np.ones(len(scalp)))


def other_path(sequence):
    sequence.path = new_sequence(0.6).path


@pytest.mark.parametrize("change", [add_solids, smooth, other_path])
def test_a_motion_that_was_asked_for_before_a_change_is_that_after_it(change):
    early, late = new_sequence(), new_sequence()
    before = early.motion(0, 0.25)
    for sequence in (early, late):
        change(sequence)
    np.testing.assert_array_equal(early.motion(0, 0.25).records, late.motion(0, 0.25).records)
    assert not np.array_equal(before.records, late.motion(0, 0.25).records)
