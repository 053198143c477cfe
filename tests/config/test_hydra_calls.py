"""Compositions that share choices are those that Hydra makes anew."""

from __future__ import annotations

import pytest
from hydra.core.config_store import ConfigStore
from hydra.core.hydra_config import HydraConfig
from hydra.errors import HydraException
from hypothesis import given, settings
from hypothesis import strategies as st
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import OmegaConfBaseException

from carigs.config import known
from carigs.config.hydra_calls import by_hydra, composed
from carigs.config.overrides import parse_single
from carigs.errors import CarigsError

CHOICES = [f"{group}={name}" for group in ("study", "preset", "subject", "variant") for name in known(group)]
VALUES = (
    "gamma=0.1", "gamma=0.2", "seed=3", "train.iterations=7", "train.iterations=null", "train={iterations:9}",
    "train.density.until=3", "study.levels=[0,0.1]", "study.name='a b'", "capture.folder=${study.name}/x=1",
    "capture.folder=null", "exaggerate.regions.nose=0.4", "exaggerate.regions={ears:0.1}", "exaggerate=paper",
    "exaggerate={gamma:0.3}", "regions.hair=[a,b]", "train.iteration=3", "train.iterations=much", "quux=1",
    "+train.new=3", "~gamma", "metrics.edit_prompt='${x}'", r"metrics.edit_prompt=\${x}",
)  # fmt: skip


def outcome(compose, overrides: list[str]) -> tuple[dict, str] | str:
    """The settings as they are written and what they allow, or the error."""
    try:
        config = compose(overrides)
    except (HydraException, OmegaConfBaseException, CarigsError) as error:
        return f"{type(error).__name__}: {error}"
    return OmegaConf.to_container(config), "; ".join(refusals(config))


def refusals(config: DictConfig) -> list[str]:
    """What is said of assignments that the settings must refuse, or must not."""
    said = []
    for key, value in {"train.iterations": "x", "train.new": 1, "gamma": [1], "exaggerate.regions.chin": 0.1}.items():
        try:
            OmegaConf.update(config, key, value)
        except OmegaConfBaseException as error:
            said.append(f"{type(error).__name__}: {error}")
    return said


def anew(overrides: list[str]) -> DictConfig:
    return by_hydra(parse_single(override).input_line for override in overrides)


def kept(overrides: list[str]) -> DictConfig:
    return composed([parse_single(override) for override in overrides])


some_overrides = st.lists(st.sampled_from((*CHOICES, *VALUES)), max_size=4)


@settings(max_examples=20)
@given(some_overrides)
def test_settings_and_errors_are_those_of_a_new_composition(overrides):
    assert outcome(kept, overrides) == outcome(anew, overrides)


@pytest.mark.slow
@settings(max_examples=200)
@given(some_overrides)
def test_settings_and_errors_of_many_overrides_are_those_of_a_new_composition(overrides):
    assert outcome(kept, overrides) == outcome(anew, overrides)


@pytest.mark.parametrize("value", VALUES)
def test_each_value_alone_and_twice(value):
    """The second time the choices are kept, and the first composition has been changed."""
    expected = outcome(anew, ["variant=surfhead", value])
    assert outcome(kept, ["variant=surfhead", value]) == expected
    assert outcome(kept, ["variant=surfhead", value]) == expected


def test_files_that_change_or_appear_are_read_again(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(HydraException):
        kept(["variant=mine"])
    (tmp_path / "conf/variant").mkdir(parents=True)
    for iterations in (3, 44):
        (tmp_path / "conf/variant/mine.yaml").write_text(f"# @package _global_\ntrain: {{iterations: {iterations}}}\n")
        assert kept(["variant=mine"]).train.iterations == iterations
    (tmp_path / "conf/variant/mine.yaml").unlink()
    with pytest.raises(HydraException):
        kept(["variant=mine"])


@pytest.mark.parametrize("override", ["gamma=0.2", "variant=nobody"])
def test_a_program_that_uses_hydra_itself_keeps_its_store(override):
    store = ConfigStore.instance()
    store.store("of_the_program", {"a": 1})
    try:
        outcome(anew, [override])
        assert store.load("of_the_program.yaml").node == {"a": 1}
        assert store.load("hydra/config.yaml").node.defaults
        assert not HydraConfig.initialized()
    finally:
        del store.repo["of_the_program.yaml"]
