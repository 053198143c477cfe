"""Files of `conf/` of one's own: what people and YAML read differently, where the package is, and which names count."""

from __future__ import annotations

from pathlib import Path

import pytest

from carigs.config import compose, compose_study, known, read_sweep
from carigs.config.conf_files import choices
from carigs.errors import CarigsError, InputError, SettingsError

DIFFERENT = (
    "010", "-010", "007", "08", "0o10", "0O17", "0b11", "0x1F", "20:30", "1:30.5", "190:20:30", "1__0", "12_", "0_1",
    "\u0661",
)  # fmt: skip
"""What YAML 1.1, Hydra, Python and people read as different numbers, or some of them as no number."""
DECIMAL = {
    "10": 10, "+10": 10, "0": 0, "1_000": 1000, "1e3": 1000, "1E+3": 1000, ".5e3": 500, "5.": 5, "0.50": 0.5, "-0.0": 0,
    "1.5e-2": 0.015, "010.5": 10.5, "'010'": 10, "12e03": 12000,
}  # fmt: skip


@pytest.fixture
def conf(tmp_path, monkeypatch):
    """Writes a file in the current directory's `conf`."""
    monkeypatch.chdir(tmp_path)
    compose.cache_clear()

    def write(name: str, text: str) -> Path:
        file = tmp_path / "conf" / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text, encoding="utf-8")
        return file

    yield write
    compose.cache_clear()


@pytest.mark.sample(20)
@pytest.mark.parametrize("number", DIFFERENT)
@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("train.iterations", "{}"),
        ("gamma", "{}"),
        ("study.levels", "[0, {}]"),
        ("exaggerate.regions", "{{nose: {}}}"),
        ("metrics.identity", "{}"),
    ],
)
def test_a_number_that_is_not_plainly_decimal_is_refused_in_files_and_on_the_command_line(conf, key, value, number):
    section, _, name = key.rpartition(".")
    text = f"{name}: {value.format(number)}"
    conf("study/mine.yaml", f"# @package _global_\n{f'{section}: {{{text}}}' if section else text}\n")
    with pytest.raises(InputError, match=rf"study.mine\.yaml: {key}(\.nose)?: YAML reads .*decimal") as caught:
        compose("study=mine")
    assert "\n" not in str(caught.value)
    typed = f"{key}={value.format(number).replace(' ', '')}"
    with pytest.raises(SettingsError):  # of the digit of another script Hydra's parser says so
        compose(typed)
    with pytest.raises(SettingsError):
        read_sweep([], [f"{typed},{typed.partition('=')[2]}"])


@pytest.mark.sample(4)
@pytest.mark.parametrize("number", DECIMAL)
def test_a_decimal_number_is_the_same_in_files_and_on_the_command_line(conf, number):
    conf("study/theirs.yaml", f"# @package _global_\ntrain: {{distortion_weight: {number}}}\n")
    typed = f"train.distortion_weight={number}"
    assert compose("study=theirs").train.distortion_weight == compose(typed).train.distortion_weight == DECIMAL[number]


@pytest.mark.parametrize("name", ["on", "010", "1.5", "~"])
def test_a_name_that_yaml_does_not_read_as_text_is_refused(conf, name):
    conf("exaggerate/mine.yaml", f"regions: {{{name}: 0.1}}\n")
    with pytest.raises(InputError, match=r"mine\.yaml: exaggerate\.regions\..*: YAML reads the name as .*quote it"):
        compose("exaggerate=mine")


@pytest.mark.parametrize(
    "start",
    [
        "# @package _global_\n",
        "%YAML 1.1\n---\n# @package _global_\n",
        "--- # mine\n#@package   _global_\n",
        "# What this study is for.\n\n---\n# @package _global_\n",
        "\ufeff# @package _global_\n",
    ],
)
def test_the_package_counts_before_the_first_key(conf, start):
    conf("study/mine.yaml", f"{start}train: {{iterations: 77}}\n")
    assert compose("study=mine").train.iterations == 77


def test_a_package_after_the_first_key_is_none(conf):
    conf("study/mine.yaml", "train: {iterations: 77}\n# @package _global_\n")
    with pytest.raises(InputError, match=r"mine\.yaml: its first line must be"):
        compose("study=mine")


@pytest.mark.parametrize(
    "name", ["._x", ".x", "_x", "..", "../study/mine", "sub/.x", "sub/_x", "/mine", "sub//mine", "..\\\\x"]
)
@pytest.mark.parametrize("group", ["study", "preset", "exaggerate", "subject"])
def test_hidden_files_and_parts_are_no_choices(conf, group, name):
    for file in ("._x", ".x", "_x", "mine", "sub/.x", "sub/_x", "sub/mine"):
        conf(f"{group}/{file}.yaml", "# @package _global_\ntrain: {iterations: 77}\n")
    with pytest.raises(SettingsError, match=rf"there is no {group} of this name; known: .*mine"):
        compose(f"{group}={name}")


def test_parts_and_folders_of_a_group_can_be_used(conf):
    conf("study/_part.yaml", "# @package _global_\ntrain: {iterations: 77}\n")
    conf("study/sub/mine.yaml", "# @package _global_\ndefaults: [/study/_part, _self_]\nstudy: {name: deep}\n")
    composed = compose("study=sub/mine")
    assert composed.train.iterations == 77 and composed.study.name == "deep"


def test_a_hidden_file_is_no_part_either(conf):
    conf("study/.part.yaml", "# @package _global_\ntrain: {iterations: 77}\n")
    conf("study/mine.yaml", "# @package _global_\ndefaults: [.part, _self_]\n")
    with pytest.raises(CarigsError, match=r"study=\.part is unknown"):
        compose("study=mine")


def test_files_of_other_programs_in_conf_hinder_nobody(conf):
    conf("config.yaml", "db: [\n")
    conf("model/net.yaml", "a: !!python/name:os.system x\n")
    assert compose().study.name == "toy"


def test_one_broken_study_is_named_and_the_others_are_composed(conf):
    conf("study/broken.yaml", "# @package _global_\ntrain: {iterations: 010}\n")
    conf("study/mine.yaml", "# @package _global_\nstudy: {name: mine}\n")
    assert compose("study=mine").study.name == "mine"
    assert {"broken", "mine"} <= {*known("study")}
    names, _, broken = choices("study").partition("; ")
    assert "mine" in names.split(", ") and "broken" not in names.split(", ")
    assert broken.startswith("broken is broken (") and "train.iterations" in broken


@pytest.mark.parametrize("operand", ["010", "20:30", "a b", "true"])
@pytest.mark.parametrize("relation", ["times", "at_least"])
def test_a_preset_is_relative_by_a_number(conf, relation, operand):
    conf("preset/mine.yaml", f"# @package _global_\ntrain: {{iterations: '${{{relation}:{operand}}}'}}\n")
    with pytest.raises(SettingsError, match=r"train\.iterations: .*is no decimal number"):
        compose("preset=mine")


@pytest.mark.parametrize("name", ["${oc.env:HOME}", "a//b", "/etc/passwd", "toy/"])
def test_a_path_is_no_choice(name):
    with pytest.raises(SettingsError, match=r"^study=.*known: .*toy"):
        compose_study(f"study={name}")
