"""Settings: composed, checked, frozen and loaded."""

from __future__ import annotations

import json
import re
from dataclasses import Field, fields
from itertools import product
from operator import ne
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf

from carigs.cli.settings import main as show_settings
from carigs.config import (
    GROUPS,
    compose,
    compose_study,
    join_overrides,
    known,
    left_out_levels,
    load_settings,
    rendered_levels,
    settings_text,
    split_overrides,
    target_levels,
)
from carigs.config.conf_files import read_choice
from carigs.config.frozen import keys_text
from carigs.errors import InputError, SettingsError
from carigs.settings import STAGES, Config, reference
from carigs.settings.option import OF_PATH, check_section, copies, keys, option_of
from carigs.settings.removed import REMOVED
from evaluation.metrics.embeddings import EMBEDDINGS
from evaluation.metrics.lpips import LPIPS_METRICS
from evaluation.metrics.networks.preprocessing import CROPS
from evaluation.metrics.stable_diffusion import MODELS

METRIC_CHOICES = {
    "embeddings": EMBEDDINGS,
    "lpips": tuple(LPIPS_METRICS),
    "diffusion": tuple(MODELS),
    "crop": CROPS,
}
ROOT = Path(__file__).parents[2]
RULES = ROOT / "workflow/rules"
OPTIONS = {key: f for key, _, f in keys(Config)}
many_compositions = pytest.mark.no_cover
"""Hydra takes twice as long while coverage is measured; other tests run the same lines."""


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


def paper_table() -> dict[str, object]:
    """Key and value of each row of the table in docs/paper.md."""
    text = (ROOT / "docs/paper.md").read_text().partition("## The preset `study=paper`, key by key")[2]
    rows = re.findall(r"^\| `([\w.]+)` \| `(.+?)` \| .+ \|$", text, re.MULTILINE)
    assert len(rows) == text.count("\n| `") and len(rows) == len(dict(rows))
    return {key: yaml.safe_load(value) for key, value in rows}


def test_the_papers_study_is_the_table_of_its_document():
    composed, table = compose("study=paper"), paper_table()
    assert {key: OmegaConf.select(composed, key, throw_on_missing=True) for key in table} == table
    assert set(table) <= {*OPTIONS}


def test_the_table_of_the_paper_has_every_key_that_its_study_changes():
    default, paper = compose(), compose("study=paper")
    changed = {key for key in OPTIONS if OmegaConf.select(default, key) != OmegaConf.select(paper, key)}
    data = {key for key in changed if key.startswith(("study.", "capture."))}
    assert changed - data <= {*paper_table()}


def test_regions_are_the_head_models_names_and_numbers(load):
    settings = load("exaggerate", "exaggerate.regions={nose:0.4,ears:0}")
    assert settings.regions == {"nose": 0.4, "ears": 0.0}
    with pytest.raises(SettingsError, match=r"exaggerate\.regions\.nose"):
        compose("exaggerate.regions={nose:long}")
    assert compose().exaggerate.regions == {}


def test_choices_of_the_metrics_are_those_of_the_evaluation():
    choices = {name: option_of(OPTIONS[f"metrics.{name}"]).choices for name in METRIC_CHOICES}
    assert choices == METRIC_CHOICES


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
        ("study=tyo", ("study=tyo", "paper, toy")),
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
        ("density.every=3", ("train.density.every or train.plateau.every?",)),
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
        ("train.ssim_weight=${gama}", ("gama",)),
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


def wrong_values(f: Field) -> list[str]:
    """Values that the field must refuse, as overrides."""
    allowed = option_of(f)
    values = ["nan"] * ("float" in f.type)
    values += [str(bound - 1) for bound in (allowed.ge,) if bound is not None]
    values += [str(bound + 1) for bound in (allowed.le,) if bound is not None]
    values += [str(bound) for bound in (allowed.gt, allowed.lt, allowed.excluded) if bound is not None]
    values += ["unheard_of"] * bool(allowed.choices)
    wrap = "[{}]" if f.type.startswith("tuple") else "{{nose: {}}}" if f.type.startswith("dict") else "{}"
    return [wrap.format(value) for value in values]


@pytest.mark.parametrize("key", OPTIONS)
def test_every_range_is_checked(key):
    for value in wrong_values(OPTIONS[key]):
        config = compose().copy()
        OmegaConf.update(config, key, OmegaConf.create(f"value: {value}").value)
        with pytest.raises(SettingsError, match=rf"^{re.escape(key)}[=.\[].*(must|unknown)"):
            check_section(Config, config)


def test_every_number_has_a_smallest_and_a_largest_value():
    free = [
        key
        for key, f in OPTIONS.items()
        if any(number in f.type for number in ("int", "float"))
        for low, high in [((option_of(f).ge, option_of(f).gt), (option_of(f).le, option_of(f).lt))]
        if low == (None, None) or high == (None, None)
    ]
    assert free == []


@pytest.mark.parametrize(
    ("make", "named"),
    [
        (lambda: STAGES["capture"](source="folder", folder="here"), "capture.head_model must be set"),
        (lambda: STAGES["train"](density=None, ssim_weight=float("nan")), "train.ssim_weight=nan must be"),
        (lambda: STAGES["gtstar"](hair_extinction=float("inf")), "gtstar.hair_extinction=inf must be a finite number"),
    ],
)
def test_a_section_checks_itself(make, named):
    with pytest.raises(SettingsError, match=named):
        make()


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


@pytest.mark.parametrize(
    ("option", "file"), [("--reference", "configuration.md"), ("--schema", "configuration.schema.json")]
)
def test_the_reference_is_current(option, file, capsys):
    """Else: carigs settings --reference > docs/configuration.md, and --schema > docs/configuration.schema.json."""
    assert show_settings([option]) == 0
    assert capsys.readouterr().out == (ROOT / "docs" / file).read_text("utf-8")


def test_every_setting_has_a_meaning():
    for _, section, f in keys(Config):
        assert reference.meanings(section)[f.name].endswith((".", ")."))


def test_the_schema_knows_every_key_of_a_composed_study():
    def described(schema: dict, at: str = "") -> set[str]:
        below = schema.get("properties", {})
        return {key for name, part in below.items() for key in described(part, f"{at}.{name}")} or {at.lstrip(".")}

    assert described(json.loads(reference.json_schema())) == {*OPTIONS}


def test_what_is_removed_is_no_key_and_is_told_what_replaces_it(tmp_path, monkeypatch):
    """Typed, in a file of a study, and in a mapping; the advice names keys that exist."""
    assert not {*REMOVED} & {*OPTIONS}
    folder = tmp_path / "conf/study"
    folder.mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    for key, advice in REMOVED.items():
        section, _, name = key.rpartition(".")
        if section:
            with pytest.raises(SettingsError, match=re.escape(f"{key}: {advice}")):
                compose_study(f"{key}=1")
            with pytest.raises(SettingsError, match=re.escape(f"{key}: {advice}")):
                compose_study(f"{section}={{{name}:1}}")
        text = name + ": 1\n"
        for above in reversed(section.split(".") if section else []):
            text = f"{above}: {{{text.strip()}}}\n"
        (folder / "old.yaml").write_text(f"# @package _global_\n{text}")
        with pytest.raises(InputError, match=rf"old\.yaml: {re.escape(f'{key}: {advice}')}"):
            compose("study=old")
        for named in re.findall(r"\b[a-z_]+\.[a-z_.]+[a-z](?==|\b)", advice):
            assert named in OPTIONS, named


def test_a_copy_has_the_type_and_the_default_of_the_key_that_sets_it():
    composed, sources = compose(), dict(copies(Config))
    for field, key in sources.items():
        if key not in (OF_PATH, "study.levels"):  # levels above gamma are left out
            assert OmegaConf.select(composed, field) == OmegaConf.select(composed, key)
    assert {key for key in sources.values() if key not in (OF_PATH, "seed", "regions")} <= {*OPTIONS}


def test_composed_settings_are_a_study_of_ones_own(tmp_path, monkeypatch):
    """What `carigs settings` prints can be written into a file of `conf/study`."""
    (tmp_path / "conf/study").mkdir(parents=True)
    monkeypatch.chdir(tmp_path)
    text = keys_text(compose_study("study=levels", "gamma=0.3"))
    (tmp_path / "conf/study/mine.yaml").write_text(f"# @package _global_\n{text}")
    assert compose_study("study=mine") == compose_study("study=levels", "gamma=0.3")


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
