"""What a command says when a package is missing that only an extra brings."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib.metadata import packages_distributions

import pytest
from project import ROOT

import carigs
from carigs.cli.main import main
from carigs.errors import PackageMissing
from carigs.system.extras import EXTRAS, naming_extras, need

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
LIGHT = ("mesh", "check", "fit", "head", "settings")
"""Commands that pyproject.toml promises without extras."""


def packages(requirements):
    """Normalised names of requirements."""
    return {re.split(r"[^\w.-]", text, maxsplit=1)[0].lower().replace("_", "-") for text in requirements}


@pytest.mark.parametrize("package", EXTRAS)
def test_the_extra_brings_the_package_and_nothing_else_does(package):
    if package not in (installed := packages_distributions()):
        pytest.skip(f"{package} is not installed")
    distributions = packages(installed[package])
    assert distributions & packages(PROJECT["optional-dependencies"][EXTRAS[package]])
    assert not distributions & packages(PROJECT["dependencies"])


def test_every_package_outside_the_extras_is_always_installed():
    """Modules that are imported anywhere but in functions, in what the light commands import."""
    code = "import importlib, sys\n" + "\n".join(f"importlib.import_module('carigs.cli.{name}')" for name in LIGHT)
    found = subprocess.run(
        [sys.executable, "-c", f"{code}\nprint(*{{name.partition('.')[0] for name in sys.modules}})"],
        capture_output=True,
        text=True,
        check=True,
    ).stdout.split()
    assert not EXTRAS.keys() & set(found)


def test_a_missing_package_names_its_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    with (
        pytest.raises(PackageMissing, match=r"torch is not installed: pip install 'carigs\[avatar\]'"),
        naming_extras(),
    ):
        import torch.nn  # noqa: F401
    with pytest.raises(PackageMissing, match="avatar"):
        need("torch")


def test_a_missing_module_of_carigs_itself_stays_a_mistake():
    with pytest.raises(ModuleNotFoundError, match="nothing"), naming_extras():
        import carigs.nothing  # noqa: F401


@pytest.mark.parametrize(
    ("command", "package"), [(["run"], "snakemake"), (["plan"], "snakemake"), (["view", "avatar.npz"], "viser")]
)
def test_commands_check_before_they_start(command, package, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, package, None)
    assert main(command) == 1
    assert f"{package} is not installed" in capsys.readouterr().err


def test_the_library_names_the_extra(monkeypatch):
    monkeypatch.delitem(sys.modules, "carigs.splat.avatar", raising=False)
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(PackageMissing, match="avatar"):
        carigs.load("avatar.npz")


def test_a_page_of_an_avatar_names_the_extra(monkeypatch):
    monkeypatch.delitem(sys.modules, "carigs.viewer.html.page", raising=False)
    monkeypatch.setitem(sys.modules, "jinja2", None)
    with pytest.raises(PackageMissing, match="avatar"):
        _ = carigs.write_html
