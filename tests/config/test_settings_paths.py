"""Settings of the stages lie where the rules of the workflow look for them."""

from __future__ import annotations

import re
from itertools import product
from operator import ne
from pathlib import Path

import pytest
import yaml

from carigs.config import GROUPS, compose, known, settings_text
from carigs.config.conf_files import read_choice
from carigs.settings import STAGES

RULES = Path(__file__).parents[2] / "workflow/rules"
many_compositions = pytest.mark.no_cover
"""Hydra takes twice as long while coverage is measured; other tests run the same lines."""


def settings_paths() -> dict[str, tuple[str, ...]]:
    """The overrides in each stage's settings path, as the rules have it."""
    text = "".join(file.read_text() for file in RULES.glob("*.smk"))
    found = re.findall(r'"results/\{study\}/settings/(\w+)/(.*?)\.yaml"', text)
    return {stage: tuple(re.findall(r"(\w+)=\{", point)) for stage, point in found}


def test_every_stage_has_its_settings():
    assert set(settings_paths()) == set(STAGES)


def points(most_changed: int) -> list[tuple[str, str, str, str]]:
    """Subject, variant, seed and gamma: all but the first point change at most so many of its values."""
    values = (("toy", "ict_s1", "nersemble_074"), ("alternating", *known("variant")), ("0", "1"), ("0.25", "0.2"))
    first = tuple(choices[0] for choices in values)
    found = (point for point in product(*values) if sum(map(ne, point, first)) <= most_changed)
    return [*dict.fromkeys(found)]


@many_compositions
@pytest.mark.slow
@pytest.mark.parametrize("stage", STAGES)
def test_a_section_changes_only_with_what_its_path_names(stage):
    """Else two jobs would share a settings file that says something else to each."""
    named = settings_paths()[stage]
    texts: dict[tuple[str, ...], set[str]] = {}
    for subject, variant, seed, gamma in points(most_changed=2):
        values = {"subject": subject, "variant": variant, "seed": seed, "gamma": gamma}
        overrides = [f"{name}={value}" for name, value in values.items()]
        texts.setdefault(tuple(values[name] for name in named), set()).add(settings_text(stage, *overrides))
    assert all(len(different) == 1 for different in texts.values())


@many_compositions
@pytest.mark.slow
def test_every_key_of_conf_is_in_the_schema():
    """Hydra checks a group's file only when it is chosen."""
    # The subjects `own` and `video` have none.
    own = ["capture.folder=anna", "capture.head_model=flame.pkl", "capture.video=anna.mp4"]
    for group in GROUPS:
        for name in known(group):
            text = read_choice(f"{group}/{name}").text
            assert yaml.safe_load(text) is None or compose(f"{group}={name}", *own)
