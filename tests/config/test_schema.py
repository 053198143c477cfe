"""The keys of the settings: ranges, meanings, removed ones, and the documents that list them."""

from __future__ import annotations

import json
import re
from dataclasses import Field
from pathlib import Path

import pytest
import yaml
from omegaconf import OmegaConf

from carigs.cli.settings import main as show_settings
from carigs.config import compose, compose_study
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
OPTIONS = {key: f for key, _, f in keys(Config)}


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


def test_choices_of_the_metrics_are_those_of_the_evaluation():
    choices = {name: option_of(OPTIONS[f"metrics.{name}"]).choices for name in METRIC_CHOICES}
    assert choices == METRIC_CHOICES


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
        (lambda: STAGES["train"](density=None, initial_scale=float("nan")), "train.initial_scale=nan must be"),
        (lambda: STAGES["gtstar"](hair_extinction=float("inf")), "gtstar.hair_extinction=inf must be a finite number"),
    ],
)
def test_a_section_checks_itself(make, named):
    with pytest.raises(SettingsError, match=named):
        make()


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
        if "properties" not in schema:
            return {at.lstrip(".")}
        return {key for name, part in schema["properties"].items() for key in described(part, f"{at}.{name}")}

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
