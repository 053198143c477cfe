"""Presets of time against quality, of the paper, and the defaults."""

from __future__ import annotations

import pytest
from omegaconf import OmegaConf

from carigs.config import GROUPS, compose, compose_study, compose_variant, known, reference
from carigs.config.conf_files import read_choice
from carigs.config.mask_variants import MASK_VARIANTS
from carigs.errors import SettingsError
from carigs.settings import STAGES, Config
from carigs.settings.option import walk

OPTIONS = [key for key, *_ in walk(Config)]
many_compositions = pytest.mark.no_cover
"""Hydra takes twice as long while coverage is measured; other tests run the same lines."""


@pytest.mark.parametrize(("stage", "preset"), [("exaggerate", "exaggerate=robust"), ("gtstar", "variant=no_mask")])
def test_default_presets_are_the_defaults(stage, preset, load):
    settings = load(stage, preset)
    assert settings == STAGES[stage]()


@pytest.mark.sample(3)
@many_compositions
@pytest.mark.parametrize("study", known("study"))
def test_presets_are_relative_to_the_study(study):
    own = compose(f"study={study}")
    assert compose(f"study={study}", "preset=balanced") == own
    for preset, factor in (("fast", 0.5), ("best", 2)):
        changed = compose(f"study={study}", f"preset={preset}")
        assert changed.train.iterations == factor * own.train.iterations
        assert changed.train.density.stop == factor * own.train.density.stop
        assert changed.train.sh_degree >= own.train.sh_degree
        for key in OPTIONS:
            if not key.startswith("train."):
                assert OmegaConf.select(changed, key) == OmegaConf.select(own, key)


@pytest.mark.slow
@many_compositions
@pytest.mark.parametrize("preset", known("preset"))
def test_a_preset_and_a_variant_change_different_settings(preset):
    """Each keeps its changes, in any order. Variants of one flag are made alike: there, one of each kind does."""
    of_a_flag = {next(name for name in MASK_VARIANTS if name.startswith("no_") == without) for without in (True, False)}
    for variant in {*known("variant")} - MASK_VARIANTS.keys() | of_a_flag:
        alone, both = compose(f"variant={variant}"), compose(f"preset={preset}", f"variant={variant}")
        assert compose(f"variant={variant}", f"preset={preset}") == both == compose_variant(variant, f"preset={preset}")
        changed, default = compose(f"preset={preset}"), compose()
        for key in OPTIONS:
            before, value = (OmegaConf.select(config, key) for config in (default, alone))
            expected = value if value != before else OmegaConf.select(changed, key)
            assert OmegaConf.select(both, key) == expected


@pytest.mark.parametrize("overrides", [("preset=best", "train.iterations=7"), ("train.iterations=7", "preset=best")])
def test_a_key_on_the_command_line_wins_over_a_preset(overrides):
    train = compose_study(*overrides, "train.sh_degree=1").train
    assert (train.iterations, train.sh_degree, train.density.stop) == (7, 1, 2 * compose().train.density.stop)


def test_a_preset_keeps_a_study_that_has_more():
    assert compose("study=paper", "preset=best").train.sh_degree == compose("study=paper").train.sh_degree == 3
    assert compose("study=toy", "preset=best").train.sh_degree == 2


def test_what_is_relative_outside_of_a_preset_is_refused():
    with pytest.raises(SettingsError, match=r"capture\.toy\.seed: .*only a preset"):
        compose("preset=fast", "capture.toy.seed=${times:2}")
    assert compose("preset=fast").train.iterations == compose().train.iterations // 2  # and leaves nothing behind


def test_presets_of_the_paper_are_literal(load):
    """The paper's weight is |K|^gamma, its path the linear blend of two solves."""
    settings = load("exaggerate", "study=paper")
    assert (settings.path_nodes, settings.region_constraint, settings.curvature_source) == (2, "literal", "template")
    assert settings.gap_stiffness == 0
    assert (
        settings.curvature_smoothing,
        settings.normalize_weights,
        settings.limit_cavities,
        settings.rigid_components,
    ) == (0, False, False, False)
    assert compose("study=paper").train.iterations == 120_000
    assert len(compose("study=paper").study.subjects) == 10


@pytest.mark.parametrize(
    ("text", "purpose"),
    [
        ("# @package _global_\n# One person: anna. The\n# second.\ncapture: {}\n# last\n", "One person: anna"),
        ("# Two lines\n# of text:\n#   carigs run\n", "Two lines of text"),
        ("# @package _global_\n# For v. 2\n", "For v"),
        ("capture: {}\n# Too late.\n", ""),
        ("", ""),
    ],
)
def test_the_purpose_of_a_preset_is_the_first_sentence_of_its_comment(text, purpose):
    assert reference.purpose(text) == purpose


@pytest.mark.parametrize("group", GROUPS)
def test_every_preset_says_what_it_is_for(group):
    for name in known(group):
        assert reference.purpose(read_choice(f"{group}/{name}").text), name
