"""Compiled kernels belong to the sources they were compiled from, and to the version of Numba."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import carigs
from carigs.runs.sources import WITHOUT_EFFECT, sources
from carigs.simd import kernel_cache, kernel_files
from carigs.simd.kernel_cache import announce_compilation
from carigs.simd.kernels import kernel


def folder_of(root: Path, **environment: str) -> Path:
    """Where a fresh process that imports the package under `root` keeps its kernels."""
    clean = {name: value for name, value in os.environ.items() if name != "NUMBA_CACHE_DIR"}
    code = "from carigs.simd.kernel_cache import kernel_folder; print(kernel_folder())"
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
    stage, formula = (
        tmp_path / "carigs" / "stages" / "truth.py",
        tmp_path / "carigs" / "splat" / "rig" / "jacobian_blend.py",
    )
    stage.write_text(stage.read_text() + "\n# edited\n")
    assert folder_of(tmp_path) == before
    formula.write_text(formula.read_text() + "\n# edited\n")
    assert folder_of(tmp_path) != before


def test_each_version_of_numba_has_its_own_folder(tmp_path):
    root, other = Path(carigs.__file__).parents[1], tmp_path / "numba-99.0.dist-info"
    other.mkdir()
    (other / "METADATA").write_text("Metadata-Version: 2.1\nName: numba\nVersion: 99.0\n")
    assert folder_of(root, PYTHONPATH=os.pathsep.join([str(tmp_path), str(root)])) != folder_of(root)


@pytest.mark.parametrize("chosen", [False, True])
def test_editing_a_module_that_a_kernel_module_imports_changes_the_folder_and_settings_do_not(chosen, tmp_path):
    """Constants of a module without a kernel are compiled into kernels: old machine code would give old results."""
    shutil.copytree(Path(carigs.__file__).parent, tmp_path / "carigs", ignore=shutil.ignore_patterns("__pycache__"))
    environment = {"NUMBA_CACHE_DIR": str(tmp_path / "cache")} if chosen else {}
    folders = [folder_of(tmp_path, **environment)]
    for name in ("raster/span.py", "head/joint_transforms.py", "splat/rasterizer/records.py"):
        with (tmp_path / "carigs" / name).open("a") as stream:
            stream.write("\nNEAR_PLANE = 1.8\n")
        folders.append(folder_of(tmp_path, **environment))
    assert len(set(folders)) == len(folders)
    for name in ("settings/train.py", "runs/sources.py", "splat/training/trainer.py"):
        with (tmp_path / "carigs" / name).open("a") as stream:
            stream.write("\nNEAR_PLANE = 1.8\n")
    assert folder_of(tmp_path, **environment) == folders[-1]


ADDED = {
    "constants": "FACTOR = 2.0\n",
    "callee": """
from numba import njit

from carigs.light.constants import FACTOR
from carigs.simd.kernels import INLINE


@njit(**INLINE)
def scaled(x):
    return FACTOR * x
""",
    "caller": """
from carigs.light.callee import scaled
from carigs.simd.kernels import kernel


@kernel
def doubled(x):
    return scaled(x)
""",
    "aside": "",
}
"""Modules of a kernel: what it calls, a constant of that, and a module that has nothing to do with them."""


@pytest.mark.slow
def test_a_kernel_is_compiled_again_after_an_edit_of_what_it_inlines_and_not_after_others(tmp_path):
    shutil.copytree(Path(carigs.__file__).parent, tmp_path / "carigs", ignore=shutil.ignore_patterns("__pycache__"))
    files = {name: tmp_path / f"carigs/light/{name}.py" for name in ADDED}
    for name, text in ADDED.items():
        files[name].write_text(text)
    code = "from carigs.light.caller import doubled as f; print(f(3.0), sum(f.stats.cache_hits.values()))"

    def outcome() -> str:
        environment = {**os.environ, "PYTHONPATH": str(tmp_path), "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, env=environment, cwd=tmp_path, check=True, capture_output=True, text=True)
        return done.stdout.strip()

    assert [outcome(), outcome()] == ["6.0 0", "6.0 1"]
    files["aside"].write_text("FACTOR = 7.0\n")
    assert outcome() == "6.0 1"
    files["constants"].write_text("FACTOR = 5.0\n")
    assert [outcome(), outcome()] == ["15.0 0", "15.0 1"]
    files["callee"].write_text(ADDED["callee"].replace("* x", "* x + 1"))
    assert [outcome(), outcome()] == ["16.0 0", "16.0 1"]


def test_every_module_that_compiles_functions_is_covered():
    """Found by the decorators that Numba's compiled functions and ours have, wherever these were imported from."""
    decorated = re.compile(
        r"^@(?:\w+\.)*(?:kernel|njit|jit|vectorize|register_jitable|overload|intrinsic|simd\w*|scalar_or_simd)\b", re.M
    )
    modules = [file for file in kernel_cache.PACKAGE.rglob("*.py") if decorated.search(file.read_text("utf-8"))]
    assert len(modules) > 30 and all(map(kernel_cache.is_covered, modules))


def test_a_kernel_of_a_module_that_is_not_covered_is_not_kept(tmp_path, monkeypatch):
    monkeypatch.setattr(kernel_files, "kernel_folder", lambda: tmp_path)
    monkeypatch.setattr(kernel_cache, "kernel_folder", lambda: tmp_path)

    def once(x):
        return x

    monkeypatch.setattr(kernel_files.inspect, "getfile", lambda _: str(kernel_cache.PACKAGE / "stages/truth.py"))
    kernel(once)(1.0)
    assert not list(tmp_path.glob("*.kernel"))


def test_the_digest_covers_what_kernel_modules_import():
    """The imports that the regular expression finds are those of Python's parser."""
    for module in ("carigs.splat.rasterizer.forward_simd", "carigs.gtstar.warp_kernels", "carigs.toy.look.shading"):
        file = kernel_cache.PACKAGE.joinpath(*module.split(".")[1:]).with_suffix(".py")
        found, pending = set(), [file]
        texts = {path: path.read_bytes() for path in kernel_cache.PACKAGE.rglob("*.py")}
        while pending:
            path = pending.pop()
            if path not in found:
                found.add(path)
                pending += kernel_cache._imports(texts[path], texts)
        expected = {
            path for path in sources(module) if path.is_relative_to(kernel_cache.PACKAGE) and path.suffix == ".py"
        }
        assert expected <= found
        names = {
            ".".join(("carigs", *path.relative_to(kernel_cache.PACKAGE).with_suffix("").parts)): path for path in found
        }
        left_out = {path for name, path in names.items() if name.startswith(WITHOUT_EFFECT)}
        assert all(path.name == "__init__.py" for path in found - expected - left_out)


def test_the_user_may_choose_the_folder(tmp_path):
    root = Path(carigs.__file__).parents[1]
    folder = folder_of(root, NUMBA_CACHE_DIR=str(tmp_path))
    assert folder.parent == tmp_path


def test_one_line_says_that_kernels_will_be_compiled_unless_they_are_there(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(kernel_cache, "kernel_folder", lambda: tmp_path)
    announce_compilation()
    line = capsys.readouterr().err
    assert str(tmp_path) in line and line.count("\n") == 1
    (tmp_path / "carigs.splat.rasterizer.forward_simd.composite_colour.0123.kernel").touch()
    announce_compilation()
    assert capsys.readouterr().err == ""


def test_no_module_uses_the_cache_of_numba():
    """Its files have no digest, and it fails where it finds no folder: `carigs.simd.kernels.kernel` has its own."""
    for file in Path(carigs.__file__).parent.rglob("*.py"):
        assert "cache=True" not in file.read_text("utf-8"), file
