"""YAML: plain settings are read; aliases, tags, depth and other things that settings do not need are refused."""

from __future__ import annotations

import os
import time

import pytest

from carigs.config import CONF, compose, load_settings, settings_text, target_maker
from carigs.config.conf_files import read_conf_file
from carigs.errors import CarigsError, InputError
from carigs.readers.yaml_files import read_yaml_text

ALIAS_BOMB = "a: &a [x,x,x,x,x,x,x,x,x]\n" + "".join(
    f"{name}: &{name} [{','.join([f'*{before}'] * 9)}]\n" for before, name in zip("abcdefgh", "bcdefghi", strict=True)
)
REFUSED = {
    ALIAS_BOMB: "alias",
    "3\n": "keys and values",
    "- 1\n": "keys and values",
    "a: 1\na: 2\n": "line 2: the key a is given twice",
    "b: {a: 1, a: 2}\n": "the key a is given twice",
    "a: !!python/name:os.system x\n": "a tag",
    "a: !!python/object/apply:os.system [true]\n": "a tag",
    "a: 1\n---\nb: 2\n": "a second document",
    "a: " + "[" * 100_000: "nested more than|nesting depth",
    "a: " + "{b: " * 50_000: "nested more than|nesting depth",
    "? [1, 2]\n: 3\n": "a key must be a name",
    "a: {<<: {b: 1}}": "a key must be a name",
    "a: 'x": "line 1 column",
    "a: \x00": "line 1 holds a NUL character",
    "a: 1\n" * 60_000: "bytes; at most",
    "".join(f"k{i}: 1\n" for i in range(6000)): "more than 10000 values",
}


@pytest.mark.parametrize("text", REFUSED, ids=range(len(REFUSED)))
def test_what_settings_do_not_need_is_refused_at_once(text, tmp_path):
    file = tmp_path / "a.yaml"
    file.write_text(text)
    start = time.process_time()
    with pytest.raises(InputError, match=REFUSED[text]) as raised:
        read_yaml_text(file)
    assert str(file) in str(raised.value) and time.process_time() - start < 1


@pytest.mark.parametrize("encoding", ["utf-16", "utf-32", "latin-1"])
def test_other_encodings_are_refused(encoding, tmp_path):
    (tmp_path / "a.yaml").write_bytes("a: ä\n".encode(encoding))
    with pytest.raises(InputError, match="not text in UTF-8"):
        read_yaml_text(tmp_path / "a.yaml")


def test_the_files_of_the_project_are_read():
    for file in CONF.rglob("*.yaml"):
        assert read_conf_file(file).text


@pytest.mark.sample(2)
@pytest.mark.parametrize("content", [ALIAS_BOMB, "!!python/name:os.system x\n", "a: [", "b: 1\nb: 2\n", None])
def test_a_file_of_ones_own_is_checked_before_hydra_opens_it(content, tmp_path, monkeypatch):
    """And hinders nobody who does not choose it. None: a named pipe, at which Hydra would wait."""
    variants = tmp_path / "conf/variant"
    variants.mkdir(parents=True)
    if content is None:
        os.mkfifo(variants / "mine.yaml")
    else:
        (variants / "mine.yaml").write_text(content)
    monkeypatch.chdir(tmp_path)
    compose.cache_clear()
    compose()
    for override in ("variant=mine", "study.variants=[theirs]"):
        with pytest.raises(
            CarigsError, match=r"mine\.yaml: |theirs is unknown; .*; mine is broken \(.*mine\.yaml: "
        ) as caught:
            compose(override)
        assert "\n" not in str(caught.value)
    assert target_maker("affine") == "affine"
    compose.cache_clear()


@pytest.mark.parametrize(("encoding", "says"), [("utf-8-sig", None), ("utf-16", "UTF-16"), ("latin-1", "Latin-1")])
def test_the_encoding_of_a_file_of_ones_own_is_named_before_hydra_opens_it(encoding, says, tmp_path, monkeypatch):
    (tmp_path / "conf/variant").mkdir(parents=True)
    text = "# @package _global_\n# Größe\ntrain:\n  initial_scale: 0.4\n"
    (tmp_path / "conf/variant/mine.yaml").write_bytes(text.encode(encoding))
    monkeypatch.chdir(tmp_path)
    compose.cache_clear()
    if says is None:
        assert compose("variant=mine").train.initial_scale == 0.4
    else:
        with pytest.raises(InputError, match=rf"mine\.yaml: .*{says}"):
            compose("variant=mine")
    compose.cache_clear()


def test_a_settings_file_that_was_cut_off_does_not_mean_defaults(tmp_path):
    lines = settings_text("train").splitlines(keepends=True)
    file = tmp_path / "train.yaml"
    for kept in range(len(lines)):
        file.write_text("".join(lines[:kept]))
        with pytest.raises(InputError, match=r"train\.yaml: "):
            load_settings("train", file)
    file.write_text("".join(lines))
    load_settings("train", file)
