"""Settings: composed, checked, frozen and loaded."""

from __future__ import annotations

from dataclasses import fields

import pytest
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf

from carigs.config import (
    compose,
    compose_study,
    join_overrides,
    known,
    left_out_levels,
    load_settings,
    rendered_levels,
    split_overrides,
    target_levels,
)
from carigs.config.frozen import keys_text
from carigs.errors import InputError, SettingsError
from carigs.settings import STAGES


@pytest.mark.parametrize("stage", STAGES)
def test_frozen_settings_come_back_as_they_were_composed(stage, load):
    settings = load(stage)
    assert isinstance(settings, STAGES[stage])
    assert OmegaConf.structured(settings) == compose()[stage]
    for field in fields(settings):
        if field.type.startswith("tuple"):
            assert isinstance(getattr(settings, field.name), tuple)


@pytest.mark.parametrize("name", known("study"))
def test_a_study_is_named_like_its_file(name):
    assert compose_study(f"study={name}").study.name == name


def test_regions_are_the_head_models_names_and_numbers(load):
    settings = load("exaggerate", "exaggerate.regions={nose:0.4,ears:0}")
    assert settings.regions == {"nose": 0.4, "ears": 0.0}
    with pytest.raises(SettingsError, match=r"exaggerate\.regions\.nose"):
        compose("exaggerate.regions={nose:long}")
    assert compose().exaggerate.regions == {}


@pytest.mark.parametrize(
    ("overrides", "gamma", "expected"),
    [
        ((), 0.25, ["0.25"]),
        (("train.num_gtstar_levels=4",), 0.25, ["0.0625", "0.125", "0.1875", "0.25"]),
        (("train.num_gtstar_levels=3",), 0.1, ["0.0333333", "0.0666667", "0.1"]),
        (("train.num_gtstar_levels=4", "train.gtstar_probability=0"), 0.25, ["0.25"]),
        (("train.gtstar_probability=0", "train.relight_surfels=false"), 0.25, []),
    ],
)
def test_targets_are_made_at_the_levels_trained_on(overrides, gamma, expected):
    assert target_levels(compose(*overrides).train, gamma) == expected


@pytest.mark.parametrize(
    ("override", "gamma", "expected"),
    [
        ("study.levels=[0,0.1,0.15,0.2,0.25]", 0.25, ["0", "0.1", "0.15", "0.2", "0.25"]),
        ("study.levels=[0.2,0.1,0.5]", 0.25, ["0", "0.1", "0.2", "0.25"]),
        ("study.levels=[0,0.1,0.15,0.2,0.25]", 0.1, ["0", "0.1"]),
        ("study.levels=[]", 0.3, ["0", "0.3"]),
        ("study.levels=[0.10000000001,0.1]", 0.25, ["0", "0.1", "0.25"]),
    ],
)
def test_rendered_levels_lie_in_the_trained_range_and_hold_its_ends(override, gamma, expected):
    assert rendered_levels(compose(override, f"gamma={gamma}")) == expected


def test_the_gamma_trained_for_reaches_the_solver():
    assert compose("gamma=0.2").exaggerate.gamma == 0.2


def test_the_later_override_wins():
    assert compose("gamma=0.1", "gamma=0.2").gamma == 0.2
    assert compose("study=paper", "study=toy").study.name == "toy"


def test_data_folder_comes_from_the_environment(monkeypatch):
    monkeypatch.setenv("CARIGS_DATA", "/elsewhere")
    compose.cache_clear()
    assert compose("subject=ict_s1").capture.folder == "/elsewhere/ict_s1"
    assert compose("subject=ict_s1").truth.folder == "/elsewhere/ict_s1/truth/level={level}"
    compose.cache_clear()


@pytest.mark.sample(25)
@pytest.mark.parametrize(
    ("override", "named"),
    [
        ("study=tyo", ("study=tyo", "paper_editing, paper_size, toy")),
        ("exaggerate=thick", ("exaggerate=thick", "paper, relative_to_mean")),
        ("preset=slow", ("preset=slow", "balanced, best, fast")),
        ("train.iterations=${times:2}", ("train.iterations", "only a preset")),
        ("study.subjects=[nobody]", ("study.subjects", "nobody", "toy")),
        ("study.variants=[surfhaed]", ("study.variants", "surfhaed", "surfhead")),
        ("study.variants=[]", ("study.variants",)),
        ("study.levels=[much]", ("study.levels[0]", "much")),
        ("study.levels=[-0.1]", ("study.levels", "-0.1")),
        ("study.name=a/b", ("study.name", "a/b")),
        ("study.name=..", ("study.name", "letters")),
        ("study.name=.", ("study.name", "letters")),
        ("study.name=.hidden", ("study.name", "letters")),
        ("study.name=-n", ("study.name", "letters")),
        ("study.name=''", ("study.name", "letters")),
        ("study.name=benchmark", ("study.name", "benchmark", "results")),
        ("study.name=stress", ("study.name", "stress", "results")),
        ("study.name=hydra", ("study.name", "hydra", "results")),
        ("study.name=Stress", ("study.name", "Stress", "results")),
        (f"study.name={'n' * 300}", ("study.name", "60")),
        (f"capture.folder={'f' * 200_000}", ("capture.folder=ff", "200015 characters")),
        ("gamma=0", ("gamma=0",)),
        ("gamma=nan", ("gamma=nan",)),
        ("gamma=lots", ("gamma", "lots")),
        ("train.num_gtstar_levels=0", ("train.num_gtstar_levels=0",)),
        ("train.iteration=3", ("train.iteration: no such setting; did you mean train.iterations?",)),
        ("train.iterations=3x", ("train.iterations", "3x")),
        ("train.iterations=2.5", ("train.iterations", "2.5")),
        ("train.iterations=null", ("train.iterations",)),
        ("train.density.untill=3", ("train.density.untill", "train.refine_tracking.until?")),
        ("trian.iterations=3", ("trian.iterations", "mean train.iterations?")),
        ("density.every=3", ("train.density.every or train.edit.every?",)),
        ("quux=3", ("quux: no such setting", "docs/configuration.md")),
        ("train={iteration:3}", ("train.iteration", "train.iterations?")),
        ("capture=3", ("capture", "3")),
        ("gamma", ("gamma",)),
        ("gamma=[", ("gamma=[",)),
        ("figures.camera=front", ("figures.camera", "front")),
        ("subject=toy", ("subject=toy", "study.subjects=[toy]")),
        ("variant=surfhead", ("variant=surfhead", "study.variants=[surfhead]")),
        ("seed=3", ("seed=3", "study.seeds=[3]")),
        ("train.seed=3", ("train.seed", "study.seeds")),
        ("train={seed:3}", ("train.seed", "study.seeds")),
        ("exaggerate.gamma=0.3", ("exaggerate.gamma", "has the value of gamma")),
        ("gtstar.regions.hair=[a]", ("gtstar.regions.hair", "has the value of regions.hair")),
        ("render.levels=[0,1]", ("render.levels", "study.levels")),
        ("train.threads=2", ("train.threads", "--set-threads train=N")),
        ("train.backend=scalar", ("train.backend=scalar", "cpu, torch or cuda")),
        ("study.seeds=[]", ("study.seeds=[]", "one or more")),
        ("study.seeds=[2,0,2]", ("study.seeds=[2, 0, 2]", "different")),
        ("study.seeds=[0,-1]", ("study.seeds[1]=-1", "[0, 4294967295]")),
        ("study.seeds=[0.5]", ("study.seeds[0]", "0.5")),
        ("study.seeds=2", ("study.seeds",)),
        ("+train.more=1", ("+train.more=1",)),
        ("~train.seed", ("~train.seed",)),
        ("train.initial_scale=${gama}", ("gama",)),
        ("gtstar.relight=sun", ("gtstar.relight=sun", "targets_and_surfels, targets or none")),
        ("gtstar.warp=cubic", ("gtstar.warp=cubic", "affine")),
        ("gtstar.supersampling=9", ("gtstar.supersampling=9", "[1, 8]")),
        ("gtstar.hair_extinction=nan", ("gtstar.hair_extinction=nan",)),
        ("study.levels=[[0.1]]", ("study.levels[0]", "must be one value")),
        ("exaggerate.regions={nose:[1]}", ("exaggerate.regions.nose", "must be one value")),
        ("train.position_lr=1e400", ("train.position_lr=inf", "finite")),
        (f"train.position_lr={'9' * 400}", ("train.position_lr",)),
        (f"capture.toy.seed={'9' * 400}", ("capture.toy.seed=999",)),
        (f"capture.toy.seed={'9' * 5000}", ("4300 digits",)),
        (f"study.levels={'[' * 3000}", ("study.levels", "brackets")),
        (f"metrics.edit_prompt={'a' * 20000}", ("metrics.edit_prompt", "20020 characters")),
        ("hydra.searchpath=[pkg://antigravity]", ("hydra.searchpath", "Hydra itself")),
    ],
)
def test_a_mistake_is_told_in_one_line_that_names_the_key(override, named):
    with pytest.raises(SettingsError) as raised:
        compose_study(override)
    message = str(raised.value)
    assert "\n" not in message
    for word in named:
        assert word in message


def test_a_training_has_the_seed_of_its_path():
    for seed in (0, 7):
        config = compose("study.seeds=[0,7]", f"seed={seed}")
        assert (config.train.seed, list(config.study.seeds), config.capture.toy.seed) == (seed, [0, 7], 1)


def test_overrides_are_split_like_words_of_a_shell_and_a_lost_quote_is_explained():
    assert split_overrides("study=ict metrics.edit_prompt='A nose' ") == ("study=ict", "metrics.edit_prompt=A nose")
    with pytest.raises(SettingsError, match=r"^hydra=metrics\.edit_prompt='A nose: .*type a blank after it"):
        split_overrides("metrics.edit_prompt='A nose")


def test_a_line_of_overrides_can_be_in_a_file(tmp_path):
    (tmp_path / "overrides.txt").write_text("study=ict metrics.edit_prompt='A nose'\n")
    assert split_overrides(f"@{tmp_path}/overrides.txt") == ("study=ict", "metrics.edit_prompt=A nose")
    with pytest.raises(InputError, match=r"nowhere\.txt"):
        split_overrides(f"@{tmp_path}/nowhere.txt")


@pytest.mark.parametrize(
    ("group", "name", "named"),
    [
        ("subject", "log", "another folder"),
        ("subject", "Settings", "another folder"),
        ("subject", "s" * 61, "60 bytes"),
        ("subject", "-rf", "letters"),
        ("subject", "a.b", "letters"),
        ("variant", "truth", "another folder"),
        ("variant", "targets", "another folder"),
    ],
)
def test_a_name_that_cannot_be_a_folder_of_the_results_is_refused(group, name, named, tmp_path, monkeypatch):
    file = tmp_path / f"conf/{group}/{name}.yaml"
    file.parent.mkdir(parents=True)
    file.write_text("# @package _global_\n")
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SettingsError, match=rf"study\.{group}s={name}: .*{named}"):
        compose(f"study.{group}s=[{name}]")


def test_subjects_of_ones_own_are_found_in_the_current_directory(tmp_path, monkeypatch):
    subjects = tmp_path / "my heads" / "conf/subject"
    subjects.mkdir(parents=True)
    (subjects / "anna.yaml").write_text("# @package _global_\ncapture: {toy: {seed: 7}}\n")
    monkeypatch.chdir(tmp_path / "my heads")
    compose.cache_clear()
    assert {"anna", "toy"} <= {*known("subject")}
    assert compose("subject=anna", "study.subjects=[anna]").capture.toy.seed == 7
    (subjects / "toy.yaml").write_text("# @package _global_\ncapture: {toy: {seed: 8}}\n")
    compose.cache_clear()
    with pytest.raises(SettingsError, match=r"subject.toy\.yaml: subject=toy comes with carigs"):
        compose()
    compose.cache_clear()


@pytest.mark.parametrize("group", ["subject", "study", "variant", "preset"])
def test_a_file_without_its_package_is_told_what_its_first_line_is(group, tmp_path, monkeypatch):
    file = tmp_path / f"conf/{group}/anna.yaml"
    file.parent.mkdir(parents=True)
    file.write_text("capture: {source: folder}\n")
    monkeypatch.chdir(tmp_path)
    compose.cache_clear()
    with pytest.raises(InputError, match=rf"{group}.anna\.yaml: its first line must be `# @package _global_`"):
        compose(f"{group}=anna")
    compose.cache_clear()


@given(st.lists(st.text(st.characters(exclude_categories=["Cs"], exclude_characters="\0"), min_size=1), max_size=5))
def test_overrides_are_joined_and_split_again(overrides):
    assert split_overrides(join_overrides(overrides)) == tuple(overrides)


def test_levels_above_gamma_are_those_left_out():
    config = compose("study.levels=[0.5,0,0.25,0.3]")
    assert left_out_levels(config) == ["0.3", "0.5"]
    assert {f"{level:g}" for level in config.study.levels} == {*left_out_levels(config), *rendered_levels(config)}


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("iterations: 3\n  seed: [", ("train.yaml",)),
        ("iteration: 3\n", ("train.yaml", "iteration", "iterations")),
        ("iterations: many\n", ("train.yaml", "iterations", "many")),
        ("iterations: 0\n", ("train.yaml", "iterations=0")),
        ("", ("train.yaml", "is missing")),
        ("iterations: 3\n", ("train.yaml", "is missing")),
    ],
)
def test_a_broken_settings_file_is_named(text, named, tmp_path):
    (tmp_path / "train.yaml").write_text(text)
    with pytest.raises(InputError) as raised:
        load_settings("train", tmp_path / "train.yaml")
    assert "\n" not in str(raised.value)
    for word in named:
        assert word in str(raised.value)


def test_composed_settings_are_a_study_of_ones_own(tmp_path, monkeypatch):
    """What `carigs settings` prints can be written into a file of `conf/study`."""
    (tmp_path / "conf/study").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    text = keys_text(compose_study("study=levels", "gamma=0.3"))
    (tmp_path / "conf/study/mine.yaml").write_text(f"# @package _global_\n{text}")
    assert compose_study("study=mine") == compose_study("study=levels", "gamma=0.3")
