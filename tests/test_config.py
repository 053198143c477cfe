"""Settings: composed, checked, frozen and loaded."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import Field, fields
from itertools import product
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st
from omegaconf import OmegaConf

from carigs.cli.settings import main as show_settings
from carigs.config import (
    CONF,
    GROUPS,
    compose,
    compose_study,
    compose_variant,
    folders,
    join_overrides,
    known,
    left_out_levels,
    load_settings,
    presets,
    rendered_levels,
    settings_text,
    split_overrides,
    target_levels,
    target_maker,
)
from carigs.errors import InputError, SettingsError
from carigs.gtstar import MaskFlag
from carigs.settings import DEFAULT_MASK_FLAGS, MASK_FLAGS, STAGES, Config, Train, reference
from carigs.settings.option import option_of, walk
from evaluation.metrics.embeddings import EMBEDDINGS
from evaluation.metrics.lpips import LPIPS_METRICS
from evaluation.metrics.preprocessing import CROPS
from evaluation.metrics.stable_diffusion import MODELS

METRIC_CHOICES = {
    "embeddings": EMBEDDINGS,
    "lpips": tuple(LPIPS_METRICS),
    "diffusion": tuple(MODELS),
    "crop": CROPS,
}
ROOT = Path(__file__).parents[1]
RULES = ROOT / "workflow/rules"
OPTIONS = {key: f for key, _, f in walk(Config)}
many_compositions = pytest.mark.no_cover
"""Hydra takes twice as long while coverage is measured; other tests run the same lines."""


@pytest.fixture(autouse=True)
def data_folder(monkeypatch):
    """The subject `ict_s1` lies in the folder CARIGS_DATA; nothing is read from it here."""
    monkeypatch.setenv("CARIGS_DATA", "/data")


def load(stage: str, *overrides: str, folder: Path):
    file = folder / f"{stage}.yaml"
    file.write_text(settings_text(stage, *overrides))
    return load_settings(stage, file)


@pytest.mark.parametrize("stage", STAGES)
def test_frozen_settings_come_back_as_they_were_composed(stage, tmp_path):
    settings = load(stage, folder=tmp_path)
    assert isinstance(settings, STAGES[stage])
    assert OmegaConf.structured(settings) == compose()[stage]
    for field in fields(settings):
        if field.type.startswith("tuple"):
            assert isinstance(getattr(settings, field.name), tuple)


@pytest.mark.parametrize("name", known("study"))
def test_a_study_is_named_like_its_file(name):
    assert compose_study(f"study={name}").study.name == name


@pytest.mark.parametrize(("stage", "preset"), [("exaggerate", "exaggerate=robust"), ("gtstar", "variant=no_mask")])
def test_default_presets_are_the_defaults(stage, preset, tmp_path):
    settings = load(stage, preset, folder=tmp_path)
    assert settings == STAGES[stage]()


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


@many_compositions
@pytest.mark.parametrize("preset", known("preset"))
def test_a_preset_and_a_variant_change_different_settings(preset):
    """Each keeps its changes, in any order."""
    for variant in known("variant"):
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
    with pytest.raises(SettingsError, match=r"train\.seed: .*only a preset"):
        compose("preset=fast", "train.seed=${times:2}")
    assert compose("preset=fast").train.iterations == compose().train.iterations // 2  # and leaves nothing behind


def test_presets_of_the_paper_are_literal(tmp_path):
    """The paper's weight is |K|^gamma, its path the linear blend of two solves."""
    settings = load("exaggerate", "study=paper", folder=tmp_path)
    assert (settings.path_nodes, settings.region_constraint, settings.curvature_source) == (2, "literal", "template")
    assert (settings.gap_stiffness, settings.cavity_stiffness) == (0, 0)
    assert (
        settings.curvature_smoothing,
        settings.normalize_weights,
        settings.limit_cavities,
        settings.rigid_components,
    ) == (0, False, False, False)
    assert compose("study=paper").train.iterations == 120_000
    assert len(compose("study=paper").study.subjects) == 10


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


def test_regions_are_the_head_models_names_and_numbers(tmp_path):
    settings = load("exaggerate", "exaggerate.regions={nose:0.4,ears:0}", folder=tmp_path)
    assert settings.regions == {"nose": 0.4, "ears": 0.0}
    with pytest.raises(SettingsError, match=r"exaggerate\.regions\.nose"):
        compose("exaggerate.regions={nose:long}")
    assert compose().exaggerate.regions == {}


@many_compositions
def test_variants_differ_in_supervision_masks_levels_and_light_only():
    trained = {name: OmegaConf.to_object(compose(f"variant={name}").train) for name in known("variant")}
    ours, reasons = trained["alternating"], {reason.name.lower() for reason in MaskFlag}
    assert [trained[name].gtstar_probability for name in ("surfhead", "gtstar_only", "no_mask")] == [0.0, 1.0, 0.35]
    assert list(trained["no_mask"].mask_flags) == []
    assert [name for name, t in trained.items() if not t.relight_surfels] == ["surfhead"]
    assert {*ours.mask_flags} == {*DEFAULT_MASK_FLAGS}
    in_studies = {name for study in known("study") for name in compose(f"study={study}").study.variants}
    for t in (trained[name] for name in in_studies):
        assert {*t.mask_flags} <= reasons
        for name in ("gtstar_probability", "mask_flags", "relight_surfels", "num_gtstar_levels"):
            setattr(t, name, getattr(ours, name))
        assert t == ours


@pytest.mark.parametrize("name", known("variant"))
def test_every_variant_can_be_composed(name):
    """And changes something of `gtstar` or `train`, unless it is the method itself."""
    config, ours = compose_variant(name), compose()
    assert name == "alternating" or (config.gtstar, config.train) != (ours.gtstar, ours.train)


@many_compositions
def test_the_study_of_masks_turns_every_default_reason_off_and_every_other_one_on_in_turn():
    ours = set(DEFAULT_MASK_FLAGS)
    changed = [
        ours ^ set(compose("study=ablation", f"variant={name}").train.mask_flags)
        for name in compose("study=ablation").study.variants
    ]
    assert {reason for reasons in changed if len(reasons) == 1 for reason in reasons} == {
        reason.name.lower() for reason in MaskFlag
    }


@pytest.mark.parametrize(
    ("variant", "changes"),
    [
        *((f"no_{flag}_mask", {flag}) for flag in ("grazing", "hair", "mouth", "newly_visible", "occluded")),
        *((f"no_{flag}_mask", {flag}) for flag in ("outside_image", "outside_mesh")),
        *((f"{flag}_mask", {flag}) for flag in ("stretched", "lids", "brows", "ears", "eyeballs")),
        ("no_visibility_mask", {"newly_visible", "occluded", "grazing"}),
        ("no_mask", set(DEFAULT_MASK_FLAGS)),
        ("alternating", set()),
    ],
)
def test_variants_add_and_remove_mask_flags(variant, changes):
    """Removed flags leave the others in their order; added ones come last."""
    expected = [flag for flag in DEFAULT_MASK_FLAGS if flag not in changes]
    expected += [flag for flag in MASK_FLAGS if flag in changes and flag not in DEFAULT_MASK_FLAGS]
    assert compose(f"variant={variant}").train.mask_flags == expected


def test_flags_of_a_variant_are_changes_of_the_studys_list():
    train = compose("train.mask_flags=[hair,lids]", "variant=no_hair_mask").train
    assert (train.mask_flags, train.add_mask_flags, train.remove_mask_flags) == (["lids"], [], [])
    assert Train(add_mask_flags=("ears",), remove_mask_flags=("hair",)).mask_flags == (
        *(flag for flag in DEFAULT_MASK_FLAGS if flag != "hair"),
        "ears",
    )


def test_mask_flags_of_the_settings_are_those_of_the_method():
    assert {*MASK_FLAGS} == {flag.name.lower() for flag in MaskFlag}


def test_choices_of_the_metrics_are_those_of_the_evaluation():
    choices = {name: option_of(OPTIONS[f"metrics.{name}"]).choices for name in METRIC_CHOICES}
    assert choices == METRIC_CHOICES


def test_targets_are_made_once_for_all_variants_with_the_same_settings():
    makers = {name: target_maker(name, "study=ablation") for name in known("variant")}
    assert {"alternating", "affine", "no_relight", "relight_targets"} <= {*makers.values()}
    assert len({*makers.values()}) == len({str(compose(f"variant={name}").gtstar) for name in makers})
    for name, maker in makers.items():
        assert compose(f"variant={name}").gtstar == compose(f"variant={maker}").gtstar
    # What a user sets for all does not keep them apart.
    assert target_maker("affine", "gtstar.warp=affine") == "alternating"


@pytest.mark.parametrize("name", known("variant"))
def test_a_variant_has_targets_and_training_of_its_own_alone(name):
    assert compose_variant(name) == compose(f"variant={name}")


def test_what_a_variant_changes_in_vain_is_named(tmp_path, monkeypatch):
    conf = tmp_path / "conf"
    shutil.copytree(CONF, conf)
    (conf / "variant/sharp.yaml").write_text("# @package _global_\nrender: {orbit_frames: 3}\n")
    monkeypatch.setattr(folders, "CONF", conf)
    compose.cache_clear()
    with pytest.raises(SettingsError, match=r"variant/sharp\.yaml: render\.orbit_frames is shared; .*gtstar and train"):
        compose_variant("sharp")
    compose.cache_clear()


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
        ("train.iteration=3", ("train.iteration", "iterations")),
        ("train.iterations=3x", ("train.iterations", "3x")),
        ("train.iterations=2.5", ("train.iterations", "2.5")),
        ("train.iterations=null", ("train.iterations",)),
        ("train.density.untill=3", ("train.density.untill", "stop")),
        ("trian.iterations=3", ("trian", "train")),
        ("capture=3", ("capture", "3")),
        ("gamma", ("gamma",)),
        ("gamma=[", ("gamma=[",)),
        ("figures.camera=front", ("figures.camera", "front")),
        ("subject=toy", ("subject=toy", "study.subjects=[toy]")),
        ("variant=surfhead", ("variant=surfhead", "study.variants=[surfhead]")),
        ("seed=3", ("seed=3", "study.seeds=[3]")),
        ("train.seed=3", ("train.seed=3", "study.seeds=[3]")),
        ("study.seeds=[]", ("study.seeds=[]", "one or more")),
        ("study.seeds=[2,0,2]", ("study.seeds=[2, 0, 2]", "different")),
        ("study.seeds=[0,-1]", ("study.seeds[1]=-1", "[0, 4294967295]")),
        ("study.seeds=[0.5]", ("study.seeds[0]", "0.5")),
        ("study.seeds=2", ("study.seeds",)),
        ("+train.more=1", ("+train.more=1",)),
        ("~train.seed", ("~train.seed",)),
        ("exaggerate.gamma=${gama}", ("gama",)),
        ("gtstar.relight=sun", ("gtstar.relight=sun", "targets_and_surfels, targets or none")),
        ("gtstar.warp=cubic", ("gtstar.warp=cubic", "affine")),
        ("gtstar.supersampling=9", ("gtstar.supersampling=9", "[1, 8]")),
        ("gtstar.grazing_cosine=nan", ("gtstar.grazing_cosine=nan",)),
        ("study.levels=[[0.1]]", ("study.levels[0]", "must be one value")),
        ("exaggerate.regions={nose:[1]}", ("exaggerate.regions.nose", "must be one value")),
        ("train.position_lr=1e400", ("train.position_lr=inf", "finite")),
        (f"train.position_lr={'9' * 400}", ("train.position_lr",)),
        (f"train.seed={'9' * 400}", ("train.seed=999",)),
        (f"train.seed={'9' * 5000}", ("4300 digits",)),
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
        assert (config.train.seed, list(config.study.seeds), config.tabulate.seed) == (seed, [0, 7], 0)


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
    wrap = "[{}]" if f.type.startswith("tuple") else "{{nose:{}}}" if f.type.startswith("dict") else "{}"
    return [wrap.format(value) for value in values]


@many_compositions
@pytest.mark.parametrize("key", OPTIONS)
def test_every_range_is_checked(key):
    for value in wrong_values(OPTIONS[key]):
        with pytest.raises(SettingsError, match=rf"^{re.escape(key)}[=.\[].*(must|unknown)"):
            compose(f"{key}={value}")


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
        (lambda: STAGES["gtstar"](max_stretch=float("inf")), "gtstar.max_stretch=inf must be a finite number"),
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
        compose()
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
    assert presets.purpose(text) == purpose


@pytest.mark.parametrize("group", GROUPS)
def test_every_preset_says_what_it_is_for(group):
    for name in known(group):
        assert presets.purpose((CONF / group / f"{name}.yaml").read_text("utf-8")), name


def test_every_setting_has_a_meaning():
    for _, section, f in walk(Config):
        assert reference.meanings(section)[f.name].endswith((".", ")."))


def test_the_schema_knows_every_key_of_a_composed_study():
    def keys(schema: dict, at: str = "") -> set[str]:
        below = schema.get("properties", {})
        return {key for name, part in below.items() for key in keys(part, f"{at}.{name}")} or {at.removeprefix(".")}

    assert keys(json.loads(reference.json_schema())) == {*OPTIONS}


def settings_paths() -> dict[str, tuple[str, ...]]:
    """The overrides in each stage's settings path, as the rules have it."""
    text = "".join(file.read_text() for file in RULES.glob("*.smk"))
    found = re.findall(r'"results/\{study\}/settings/(\w+)/(.*?)\.yaml"', text)
    return {stage: tuple(re.findall(r"(\w+)=\{", point)) for stage, point in found}


def test_every_stage_has_its_settings():
    assert set(settings_paths()) == set(STAGES)


@many_compositions
@pytest.mark.slow
@pytest.mark.parametrize("stage", STAGES)
def test_a_section_changes_only_with_what_its_path_names(stage):
    """Else two jobs would share a settings file that says something else to each."""
    named = settings_paths()[stage]
    texts: dict[tuple[str, ...], set[str]] = {}
    subjects, seeds, gammas = ("toy", "ict_s1", "nersemble_074"), ("0", "1"), ("0.25", "0.2")
    for subject, variant, seed, gamma in product(subjects, known("variant"), seeds, gammas):
        values = {"subject": subject, "variant": variant, "seed": seed, "gamma": gamma}
        overrides = [f"{name}={value}" for name, value in values.items()]
        texts.setdefault(tuple(values[name] for name in named), set()).add(settings_text(stage, *overrides))
    assert all(len(different) == 1 for different in texts.values())


@many_compositions
@pytest.mark.slow
def test_every_key_of_conf_is_in_the_schema():
    """Hydra checks a group's file only when it is chosen."""
    own = ["capture.folder=anna", "capture.head_model=flame.pkl"]  # the subject `own` has none
    for group in GROUPS:
        for name in known(group):
            text = (CONF / group / f"{name}.yaml").read_text()
            assert yaml.safe_load(text) is None or compose(f"{group}={name}", *own)
