"""Damaged copies of a path-traced capture are noticed; odd ones are accepted."""

from __future__ import annotations

import re
from collections.abc import Callable
from functools import cache
from pathlib import Path

import pytest
from shared_data import DATA, needs_data

from stress.capture_changes.cases import cases
from stress.capture_changes.edits import edit_transforms
from stress.capture_changes.folder import copy_capture
from stress.captures import Outcome, examine

TIMESTEPS = (*range(8), 28)
"""Those that the cases change, their neighbours, and one of the test split: a third of all, in all cameras."""
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


@pytest.fixture(scope="module")
def outcome_of(tmp_path_factory) -> Callable[[str, str], Outcome]:
    """Examines a case on a subject with few timesteps."""

    @cache
    def shortened(subject: str) -> Path:
        folder = copy_capture(DATA / subject, DATA / "ict_model.npz", tmp_path_factory.mktemp(subject) / "capture")
        edit_transforms(folder, lambda entries: [e for e in entries if e["timestep_index"] in TIMESTEPS])
        for file in folder.root.glob("*/*"):
            if int(re.match(r"\d+", file.name)[0]) not in TIMESTEPS:
                file.unlink()
        return folder.root

    return lambda name, subject: examine(CASES[name], shortened(subject), DATA / "ict_model.npz")


@needs_data
@pytest.mark.slow
@pytest.mark.parametrize("name", SOME)
def test_damage_is_noticed_and_oddities_are_accepted(name, outcome_of):
    outcome = outcome_of(name, "ict_s1")
    assert outcome.holds, outcome


@needs_data
@pytest.mark.slow
def test_long_hair_is_no_damage(outcome_of):
    outcome = outcome_of("as it is", "ict_s7")
    assert outcome.outcome == "accepted", outcome


@needs_data
@pytest.mark.slow
def test_messages_do_not_name_temporary_folders(outcome_of):
    outcome = outcome_of("skinning weights times 7", "ict_s1")
    assert re.match(r"head_model\.npz: weights: ", outcome.message)
