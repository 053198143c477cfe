"""Variants of the method: what they change, and which of them share targets."""

from __future__ import annotations

import shutil

import pytest
from omegaconf import OmegaConf

from carigs.config import CONF, compose, compose_variant, folders, known, target_maker
from carigs.config.mask_variants import MASK_VARIANTS
from carigs.errors import SettingsError
from carigs.gtstar import MaskFlag
from carigs.settings import DEFAULT_MASK_FLAGS, MASK_FLAGS, Train

many_compositions = pytest.mark.no_cover
"""Hydra takes twice as long while coverage is measured; other tests run the same lines."""


@pytest.mark.slow
@many_compositions
def test_variants_differ_in_supervision_masks_levels_and_light_only():
    trained = {name: OmegaConf.to_object(compose(f"variant={name}").train) for name in known("variant")}
    ours, reasons = trained["alternating"], {reason.name.lower() for reason in MaskFlag}
    assert [trained[name].gtstar_probability for name in ("surfhead", "gtstar_only", "no_mask")] == [0.0, 1.0, 0.12]
    assert list(trained["no_mask"].mask_flags) == []
    edited = {name for name, t in trained.items() if t.edit.editor != "none"}
    assert {name for name, t in trained.items() if not t.relight_surfels} == {"surfhead", *edited}
    assert {*ours.mask_flags} == {*DEFAULT_MASK_FLAGS}
    in_studies = {name for study in known("study") for name in compose(f"study={study}").study.variants}
    for t in (trained[name] for name in in_studies):
        assert {*t.mask_flags} <= reasons
        for name in ("gtstar_probability", "mask_flags", "relight_surfels", "num_gtstar_levels", "edit"):
            setattr(t, name, getattr(ours, name))
        assert t == ours


@pytest.mark.sample(8)
@pytest.mark.parametrize("name", known("variant"))
def test_every_variant_can_be_composed(name):
    """And changes something of `gtstar` or `train`, unless it is the method itself."""
    config, ours = compose_variant(name), compose()
    assert name == "alternating" or (config.gtstar, config.train) != (ours.gtstar, ours.train)


def test_each_mask_flag_makes_a_variant():
    for flag in MASK_FLAGS:
        name = f"no_{flag}_mask" if flag in DEFAULT_MASK_FLAGS else f"{flag}_mask"
        assert name in known("variant")
        assert set(DEFAULT_MASK_FLAGS) ^ set(compose(f"variant={name}").train.mask_flags) == {flag}
    assert not {*MASK_VARIANTS} & {file.stem for file in (CONF / "variant").glob("*.yaml")}


def test_a_file_with_the_name_of_such_a_variant_is_refused_unless_it_is_the_same(tmp_path, monkeypatch):
    (tmp_path / "conf/variant").mkdir(parents=True)
    file = tmp_path / "conf/variant/no_hair_mask.yaml"
    monkeypatch.chdir(tmp_path)
    file.write_text(MASK_VARIANTS["no_hair_mask"])  # as carigs had it in conf/variant
    compose.cache_clear()
    assert "hair" not in compose("variant=no_hair_mask").train.mask_flags
    file.write_text("# @package _global_\ntrain: {iterations: 7}\n")
    compose.cache_clear()
    with pytest.raises(
        SettingsError, match=r"no_hair_mask\.yaml: variant=no_hair_mask comes with carigs; choose another"
    ):
        compose("variant=no_hair_mask")
    compose.cache_clear()


@pytest.mark.slow
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
        *((f"no_{flag}_mask", {flag}) for flag in ("outside_image", "outside_mesh", "brows")),
        *((f"{flag}_mask", {flag}) for flag in ("stretched", "lids", "ears", "eyeballs")),
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


@pytest.mark.slow
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
