"""The sources of a stage, and when its fingerprint changes."""

from __future__ import annotations

import pytest

from carigs.errors import CarigsError
from carigs.runs import sources as module
from carigs.runs.sources import ROOT, fingerprint, package_versions, sources
from carigs.settings import STAGES

UPSTREAM = ("capture", "hair", "exaggerate", "gtstar", "train")
"""Stages whose change trains a person again."""


def names(stage: str, *without: str) -> set[str]:
    return {str(file.relative_to(ROOT)) for file in sources(f"carigs.stages.{stage}", without)}


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_is_made_of_itself_and_of_no_other_stage(stage):
    assert {name for name in names(stage) if name.startswith("carigs/stages/")} == {f"carigs/stages/{stage}.py"}


@pytest.mark.parametrize(
    ("stage", "part"),
    [
        ("exaggerate", "carigs/exaggeration/exaggerator.py"),
        ("gtstar", "carigs/gtstar/warp.py"),
        ("train", "carigs/splat/training/trainer.py"),  # imported inside the function
        ("metrics", "carigs/weights/registry.toml"),  # data of a module
    ],
)
def test_detours_and_imports_inside_functions_count(stage, part):
    assert part in names(stage)


@pytest.mark.parametrize("stage", UPSTREAM)
def test_training_does_not_depend_on_how_it_is_measured_and_drawn(stage):
    assert not {name for name in names(stage) if name.startswith("evaluation")}


@pytest.mark.parametrize("stage", UPSTREAM)
def test_the_training_of_a_person_does_not_depend_on_the_toy(stage):
    assert not {name for name in names(stage, "carigs.toy") if name.startswith("carigs/toy")}
    assert names(stage, "carigs.toy") <= names(stage)


def test_packages_are_those_that_a_stage_uses(monkeypatch):
    assert "torch" in package_versions("carigs.stages.train") and "torch" not in package_versions("carigs.stages.hair")
    assert "numpy" in package_versions("carigs.stages.hair")
    assert "matplotlib" not in package_versions("carigs.stages.train")
    monkeypatch.setattr(module, "version", lambda name: "9" if name == "cholespy" else "1")
    module._version.cache_clear()
    assert package_versions("carigs.stages.exaggerate")["cholespy"] == "9"  # optional: it chooses the solver
    module._version.cache_clear()


@pytest.fixture
def package(tmp_path, monkeypatch):
    """`carigs.one` imports `carigs.two` inside a function."""
    (tmp_path / "carigs").mkdir()
    (tmp_path / "carigs/one.py").write_text("def run():\n    from carigs import two\n    return two.X\n")
    (tmp_path / "carigs/two.py").write_text("X = 1\n")
    (tmp_path / "carigs/three.py").write_text("X = 1\n")
    monkeypatch.setattr(module, "ROOT", tmp_path)
    return tmp_path / "carigs"


@pytest.mark.parametrize(
    ("file", "text", "changes"),
    [
        ("one.py", "def run():\n    from carigs import two\n    return 2 * two.X\n", True),
        ("two.py", "X = 2\n", True),
        ("two.json", "{}", True),
        ("two.py", "# a word\nX  =  1\n", False),
        ("two.py", '"""A module."""\nX = 1\n"""A constant."""\n', False),
        ("one.py", 'def run():\n    """Run it."""\n    from carigs import two\n    return two.X\n', False),
        ("two.py", 'X = 1\nY = "a text that is used"\n', True),
        ("three.py", "X = 2\n", False),
    ],
)
def test_the_fingerprint_changes_with_what_the_module_does(package, file, text, changes):
    before = fingerprint("carigs.one")
    (package / file).write_text(text)
    for cached in (module._digest, module._data, module._source):
        cached.cache_clear()
    assert (fingerprint("carigs.one") != before) == changes


def test_a_module_with_a_syntax_error_is_named(package):
    (package / "two.py").write_text("X = (\n")
    module._source.cache_clear()
    with pytest.raises(CarigsError, match=r"two\.py: line 1"):
        fingerprint("carigs.one")


def test_a_module_that_is_not_there_is_refused(package):
    with pytest.raises(ModuleNotFoundError, match=r"stages\.nothing"):
        fingerprint("carigs.stages.nothing")
