"""pyproject.toml, requirements.lock, environment.yml and what is installed say the same."""

from __future__ import annotations

import platform
import re
import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
LOCKED = [
    Requirement(line.rstrip("\\ "))
    for line in (ROOT / "requirements.lock").read_text().splitlines()
    if re.match(r"[\w.-]+==", line)
]
EXTRAS = PROJECT["optional-dependencies"]
WANTED = [
    requirement
    for text in (*PROJECT["dependencies"], *EXTRAS["avatar"], *EXTRAS["viewer"], *EXTRAS["study"], *EXTRAS["dev"])
    if (requirement := Requirement(text)).name != PROJECT["name"]
]


def pinned(name: str) -> str:
    """The version in the lock for this machine."""
    found = [
        requirement
        for requirement in LOCKED
        if canonicalize_name(requirement.name) == canonicalize_name(name)
        and (requirement.marker is None or requirement.marker.evaluate())
    ]
    assert len(found) == 1, f"{name} stands {len(found)} times in requirements.lock"
    return next(iter(found[0].specifier)).version


@pytest.mark.parametrize("requirement", WANTED, ids=lambda requirement: requirement.name)
def test_the_lock_and_this_environment_fulfil_pyproject(requirement):
    assert pinned(requirement.name) in requirement.specifier
    assert version(requirement.name).removesuffix("+cpu") == pinned(requirement.name)


def test_every_pin_has_hashes():
    blocks = re.split(r"\n(?=[\w.-]+==)", (ROOT / "requirements.lock").read_text())
    assert all("--hash=sha256:" in block for block in blocks if re.match(r"[\w.-]+==", block))


def test_conda_takes_python_from_pyproject_and_all_else_from_the_lock():
    dependencies = yaml.safe_load((ROOT / "environment.yml").read_text())["dependencies"]
    (python,) = (entry for entry in dependencies if isinstance(entry, str) and entry.startswith("python="))
    (pip,) = (entry["pip"] for entry in dependencies if isinstance(entry, dict))
    assert SpecifierSet(PROJECT["requires-python"]).contains(f"{python.removeprefix('python=')}.0")
    assert pip == ["--requirement requirements.lock"]
    assert [entry for entry in dependencies if isinstance(entry, str)] == [python, "pip"]


def test_this_python_is_supported():
    assert platform.python_version() in SpecifierSet(PROJECT["requires-python"])
