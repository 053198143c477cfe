"""Damaged copies of a path-traced capture are noticed; odd ones are accepted."""

from __future__ import annotations

import re

import pytest
from shared_data import DATA, needs_data

from stress.capture_changes.cases import cases
from stress.captures import examine

CASES = {case.name: case for case in cases()}
SOME = (
    "rotations are transposed",
    "fl_x and fl_y times 0.8",
    "two neighbouring parameter files are swapped",
    "two images of a timestep are swapped",
    "mattes are inverted",
    "dark on black",
    "an eighth of the resolution",
    "a timestep of each split",
)


def test_names_of_cases_are_unique():
    assert len(CASES) == len(cases())


@needs_data
@pytest.mark.slow
@pytest.mark.parametrize("name", SOME)
def test_damage_is_noticed_and_oddities_are_accepted(name):
    outcome = examine(CASES[name], DATA / "ict_s1", DATA / "ict_model.npz")
    assert outcome.holds, outcome


@needs_data
@pytest.mark.slow
def test_long_hair_is_no_damage():
    outcome = examine(CASES["as it is"], DATA / "ict_s7", DATA / "ict_model.npz")
    assert outcome.outcome == "accepted", outcome


@needs_data
@pytest.mark.slow
def test_messages_do_not_name_temporary_folders():
    outcome = examine(CASES["skinning weights times 7"], DATA / "ict_s1", DATA / "ict_model.npz")
    assert re.match(r"head_model\.npz: weights: ", outcome.message)
