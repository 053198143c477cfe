"""Compiled kernels belong to the sources they were compiled from, and to the version of Numba."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import numba

import carigs
from carigs.simd.kernel_cache import announce_compilation


def folder_of(root: Path, **environment: str) -> Path:
    """Where a fresh process that imports the package under `root` keeps its kernels."""
    clean = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    code = "import carigs, numba; print(numba.config.CACHE_DIR)"
    done = subprocess.run(
        [sys.executable, "-c", code],
        env={**clean, "PYTHONPATH": str(root), **environment},
        cwd=root,
        check=True,
        capture_output=True,
        text=True,
    )
    return Path(done.stdout.strip())


def test_editing_a_formula_changes_the_folder_and_editing_anything_else_does_not(tmp_path):
    shutil.copytree(Path(carigs.__file__).parent, tmp_path / "carigs", ignore=shutil.ignore_patterns("__pycache__"))
    before = folder_of(tmp_path)
    assert before.is_relative_to(tmp_path)
    settings, formula = (
        tmp_path / "carigs" / "settings" / "option.py",
        tmp_path / "carigs" / "splat" / "rig" / "jacobian_blend.py",
    )
    settings.write_text(settings.read_text() + "\n# edited\n")
    assert folder_of(tmp_path) == before
    formula.write_text(formula.read_text() + "\n# edited\n")
    assert folder_of(tmp_path) != before


def test_each_version_of_numba_has_its_own_folder(tmp_path):
    root, other = Path(carigs.__file__).parents[1], tmp_path / "numba-99.0.dist-info"
    other.mkdir()
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: numba\nVersion: 99.0\n")
    assert folder_of(root, PYTHONPATH=os.pathsep.join([str(tmp_path), str(root)])) != folder_of(root)


def test_the_user_may_choose_the_folder(tmp_path):
    assert folder_of(Path(carigs.__file__).parents[1], NUMBA_CACHE_DIR=str(tmp_path)) == tmp_path


def test_one_line_says_that_kernels_will_be_compiled_unless_they_are_there(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(numba.config, "CACHE_DIR", str(tmp_path))
    announce_compilation()
    line = capsys.readouterr().err
    assert str(tmp_path) in line and line.count("\n") == 1
    (tmp_path / "splat").mkdir()
    (tmp_path / "splat" / "forward_simd._composite_colour-181.py311.nbi").touch()
    announce_compilation()
    assert capsys.readouterr().err == ""
