"""Texts as values of settings: typed, in files, frozen for a job, and read by it."""

from __future__ import annotations

import os
import re
import shlex
import socket
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from omegaconf import OmegaConf
from snakemake.cli import parse_config

from carigs.config import compose, load_settings, read_sweep, settings_text, snakemake_config, split_overrides
from carigs.config.conf_files import read_conf_file
from carigs.config.frozen import yaml_text
from carigs.config.literals import literal
from carigs.config.overrides import parse_override, parse_single
from carigs.errors import InputError, SettingsError
from carigs.settings import STAGES, Config
from carigs.settings.option import option_of, walk

FILES = (
    "results/toy/toy/gamma=0.25/alternating/seed=0/avatar.npz",
    "avatar~1 (copy).npz", "größe/头.npz", "take#3.npz", "it's.npz", 'a"b".npz', "wow!.npz", " a.npz", "a: b", "a;b",
    "{gamma}[1].npz", "$HOME/a", "50%.npz", r"C:\heads\anna", r"\\server\share", "ends\\", "😀.npz", "7up.npz",
    "-rf", "nullavatar.npz", "1e5", "007", "1_000", "true", "inf", "0x1f", "a&b|c<d>e", "@file", "+x", "*?", "`id`",
    "2024-01-01", "range (3).npz", "x(1", "=", "==",
)  # fmt: skip
SPECIAL = (
    "${", "\\", "}", "'", '"', ",", "$", "=", "#", "~", "1e5", "on", "0o17", ".inf", "2024-01-01", "null", "[", "]",
    "{", "(", ")", "!", "&", "*", "|", "<<", ": ", " #", "\n", "\t", "\u2028", "\x85", "\ufeff", "😀", "%", "@",
    "oc.env:HOME",
)  # fmt: skip
CHARACTERS = st.characters(exclude_categories=["Cs"], exclude_characters="\0")
TEXTS = st.lists(st.sampled_from(SPECIAL) | st.text(CHARACTERS, max_size=4), max_size=6).map("".join)
PATHS = [key for key, _, f in walk(Config) if option_of(f).is_path]


@pytest.mark.parametrize("name", FILES)
def test_a_path_is_taken_as_it_stands(name):
    assert parse_override(parse_single(f"train.start={name}").input_line).value() == name


@pytest.mark.parametrize("name", [FILES[0], "".join(sorted(set("".join(FILES)) - {","}))])
def test_a_path_with_any_characters_is_composed(name):
    assert compose(f"train.start={name}").train.start == name


@pytest.mark.parametrize("key", ["metrics.edit_prompt", "tabulate.reference", "capture.split"])
def test_other_texts_are_taken_as_they_stand(key):
    for text in ("a=b", "0.5", "~", "why? (ü)"):
        assert parse_override(parse_single(f"{key}={text}").input_line).value() == text


def test_elements_of_lists_are_taken_as_they_stand():
    found = compose("regions.hair=[a=b, 1e5,'c,d',(x)#]").gtstar.regions.hair
    assert [*found] == ["a=b", "1e5", "c,d", "(x)#"]
    assert [*compose("regions.hair=[ ]").gtstar.regions.hair] == []


def test_quotes_nothing_and_interpolations_keep_their_meaning(monkeypatch):
    monkeypatch.setenv("PLACE", "/a,b")
    compose.cache_clear()
    for value, text in {
        "'a,b'": "a,b",
        '"it\'s"': "it's",
        "null": None,
        "NULL": None,
        "'null'": "null",
        "": "",
        "${oc.env:PLACE}/x=1": "/a,b/x=1",
        "${oc.env:NOWHERE,/c}/x": "/c/x",
        r"\${oc.env:PLACE}": "${oc.env:PLACE}",
    }.items():
        assert compose(f"train.start={value}").train.start == text
    compose.cache_clear()


def test_a_comma_and_functions_separate_the_values_of_a_sweep():
    for swept in ("train.start=a=1.npz,'b,2.npz'", "train.start=choice('a=1.npz','b,2.npz')"):
        combinations = read_sweep([], [swept]).combinations
        assert [compose(*c.overrides).train.start for c in combinations] == ["a=1.npz", "b,2.npz"]
    lists = read_sweep([], ["regions.hair=[a=b],[c,d#]"]).combinations
    assert [[*compose(*c.overrides).gtstar.regions.hair] for c in lists] == [["a=b"], ["c", "d#"]]
    assert len(read_sweep([], ["gamma=0.1,0.2"]).combinations) == 2


@pytest.mark.parametrize(
    "override", ["train.start=a,b.npz", "metrics.edit_prompt=choice(a,b)", "study.name='x", "metrics.edit_prompt=$x,!`"]
)
def test_the_advice_is_a_command_that_works(override):
    with pytest.raises(SettingsError) as raised:
        compose(override)
    (word,) = shlex.split(str(raised.value).partition("quote the value: ")[2])
    key, _, text = override.partition("=")
    assert parse_override(parse_single(word).input_line).value() == text and word.startswith(key)


@pytest.mark.parametrize(
    ("override", "named"),
    [
        ("gamma=0;25", "gamma=0;25: expected a number"),
        ("train.iterations=5#", "a whole number"),
        ("study.levels=[0,0.1#]", "a list of numbers"),
        ("exaggerate.regions={my nose#:1}", "names with numbers"),
        ("trian.start=(", "docs/configuration.md"),
        ("study=my#study", "known: ablation"),
        ("=1", "expected KEY=VALUE"),
        ("", "expected KEY=VALUE"),
        ("gamma 0.1", "expected KEY=VALUE"),
        ("gamma=0.1,0.2", "`carigs sweep`"),
        ("metrics.edit_prompt=a${b", r"'metrics.edit_prompt=a\${b'"),
        ("regions.hair=[a,b#", "a list of texts"),
    ],
)
def test_no_word_of_the_parser_reaches_the_user(override, named):
    with pytest.raises(SettingsError, match=re.escape(named)) as raised:
        compose(override)
    for word in ("mismatched", "token", "viable", "Lexer", "extraneous", "input"):
        assert word not in str(raised.value)


@settings(deadline=None)
@given(st.sampled_from(["gamma", "study.levels", "exaggerate.regions", "train.start", "study", "a", ""]), TEXTS)
def test_any_override_is_parsed_or_one_typed_line(key, text):
    try:
        parse_override(f"{key}={text}")
    except SettingsError as error:
        assert "\n" not in str(error)


@settings(deadline=None)
@given(TEXTS)
def test_a_text_is_taken_as_it_stands_or_refused(text):
    bare = text.strip()
    try:
        value = parse_override(parse_single(f"metrics.edit_prompt={text}").input_line).value()
    except SettingsError:
        return
    if bare.lower() != "null" and not bare.startswith(("'", '"')):
        assert value == text


@settings(deadline=None)
@given(st.lists(TEXTS.map(lambda text: f"train.start={text}"), max_size=3))
@example(["a=x: y", "b= #c"])
def test_overrides_pass_through_snakemake(overrides):
    config = parse_config(snakemake_config(overrides))
    assert split_overrides(str(config["hydra"] or "")) == tuple(overrides)


@settings(deadline=None)
@given(text=TEXTS, element=TEXTS)
@example(text="${oc.env:HOME}", element=r"\\${times:2}")
def test_every_text_survives_the_settings_file_of_a_job(text, element, tmp_path_factory):
    file = tmp_path_factory.getbasetemp() / "tabulate.yaml"
    section = STAGES["tabulate"](reference=literal(text))
    file.write_text(yaml_text(OmegaConf.structured(section)), encoding="utf-8")
    assert load_settings("tabulate", file).reference == text
    section = STAGES["sweep"](metrics=(literal(element),))
    file.write_text(yaml_text(OmegaConf.structured(section)), encoding="utf-8")
    assert load_settings("sweep", file).metrics == (element,)


@pytest.mark.parametrize(
    ("typed", "text"),
    [
        (r"\${oc.env:SECRET}", "${oc.env:SECRET}"),
        (r"a \\\${oc.env:SECRET}", r"a \${oc.env:SECRET}"),
        (r"\${times:2} \${gamma}", "${times:2} ${gamma}"),
        (r"\${a \${b", "${a ${b"),
    ],
)
def test_an_interpolation_is_resolved_once(load, monkeypatch, typed, text):
    monkeypatch.setenv("SECRET", "told")
    assert load("metrics", f"metrics.edit_prompt={typed}").edit_prompt == text
    assert text.rpartition(" ")[2] in settings_text("metrics", f"metrics.edit_prompt={typed}")


def test_what_an_environment_variable_holds_is_no_interpolation(load, monkeypatch):
    monkeypatch.setenv("SECRET", "told")
    monkeypatch.setenv("PROMPT", "${oc.env:SECRET}")
    compose.cache_clear()
    assert load("metrics", "metrics.edit_prompt=${oc.env:PROMPT}").edit_prompt == "${oc.env:SECRET}"
    assert load("hair", r"regions.hair=[\${oc.env:SECRET}]").regions.hair == ("${oc.env:SECRET}",)
    compose.cache_clear()


def test_escapes_in_conf_are_resolved_once(tmp_path, monkeypatch):
    monkeypatch.setenv("SECRET", "told")
    file = tmp_path / "conf/study/mine.yaml"
    file.parent.mkdir(parents=True)
    file.write_text(
        "# @package _global_\nmetrics: {edit_prompt: '\\${oc.env:SECRET}'}\nexaggerate: {regions: {'${gamma}': 0.1}}\n"
    )
    monkeypatch.chdir(tmp_path)
    compose.cache_clear()
    composed = compose("study=mine")
    assert composed.metrics.edit_prompt == "${oc.env:SECRET}" and [*composed.exaggerate.regions] == ["${gamma}"]
    compose.cache_clear()


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("train: {start: 007}", "train.start: YAML reads the value as 7"),
        ("study: {name: 1e5}", "study.name: YAML reads the value as 100000.0"),
        ("tabulate: {reference: on}", "tabulate.reference: YAML reads the value as True"),
        ("regions: {hair: [scalp, 12]}", "regions.hair: YAML reads the value as 12"),
        ("metrics: {edit_prompt: 'a ${b'}", "starts no interpolation"),
    ],
)
def test_a_file_whose_text_yaml_would_change_is_refused(text, named, tmp_path):
    file = tmp_path / "study/mine.yaml"
    file.parent.mkdir()
    file.write_text(f"# @package _global_\n{text}\n")
    with pytest.raises(InputError, match=re.escape(named)):
        read_conf_file(file)


@pytest.fixture
def odd_files(tmp_path, monkeypatch):
    """Paths from which nothing can be read, with a part of what is said of them."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    (tmp_path / "to_pipe").symlink_to(tmp_path / "pipe")
    monkeypatch.chdir(tmp_path)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind("socket")
        yield {
            "f" * 5000: "too long",
            f"{'f' * 300}/x": "too long",
            "/".join(["f" * 100] * 50): "too long",
            "a\0b": "control character",
            "a\nb": "control character",
            "a\x1b[2J": "control character",
            "   ": "blank",
            "\udcff": "UTF-8",
            "/dev/zero": "a device",
            f"{tmp_path}/pipe": "a named pipe",
            f"{tmp_path}/to_pipe": "a named pipe",
            f"{tmp_path}/socket": "a socket",
            f"{tmp_path}/loop": "circle",
            f"{tmp_path}/loop/x": "circle",
            "~/heads": f"type {Path.home()}/heads",
        }


@pytest.mark.parametrize("key", PATHS)
def test_a_path_from_which_nothing_can_be_read_is_refused_before_it_is_opened(key, odd_files):
    stage, _, name = key.partition(".")
    for path, named in odd_files.items():
        with pytest.raises(SettingsError, match=rf"^{re.escape(key)}=.*{re.escape(named)}"):
            STAGES[stage](**{name: path})
    for path in ("nowhere/x", ".", "", None, "a{gamma}b"):
        STAGES[stage](**{name: path})


def test_a_typed_path_is_checked_when_settings_are_composed(odd_files):
    for path in ("f" * 5000, "pipe"):
        with pytest.raises(SettingsError, match=rf"^capture\.folder=.*{re.escape(path[:60])}"):
            compose(f"capture.folder={path}")
