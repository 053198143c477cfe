"""The project in a folder of its own: a copy of the repository, or the files of the installed package."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from forked_commands import run_command

from carigs.simd.kernel_cache import kernel_folder

ROOT = Path(__file__).parents[1]
NO_CACHES = shutil.ignore_patterns("__pycache__")


@dataclass(frozen=True)
class Project:
    """A folder with the project, and its command line."""

    root: Path

    def start(self, *command: str) -> subprocess.Popen:
        """Start `python -m ...` in the project, as a process group; of this checkout only the environment is used."""
        return subprocess.Popen(
            [sys.executable, "-m", *command],
            cwd=self.root,
            env={**os.environ, **environment(self.root)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def command(self, *command: str) -> subprocess.CompletedProcess:
        """Run `python -m ...` in the project."""
        return run_command(command, self.root, {**os.environ, **environment(self.root)})

    def snakemake(self, *arguments: str, hydra: str = "") -> subprocess.CompletedProcess:
        """Snakemake with Hydra overrides; `--` ends the values of --config."""
        return self.command("snakemake", *arguments[:-1], "--config", f"hydra={hydra}", "--", *arguments[-1].split())

    def make(self, *targets: str, hydra: str = "") -> None:
        """Make the targets; fails with all that Snakemake says."""
        done = self.snakemake("--cores", "2", " ".join(targets), hydra=hydra)
        assert done.returncode == 0, done.stdout + done.stderr

    def planned(self, *targets: str, hydra: str = "") -> dict[str, int]:
        """How many jobs of each rule a dry run announces, the two targets left out."""
        done = self.snakemake("-n", " ".join(targets), hydra=hydra)
        assert done.returncode == 0, done.stdout + done.stderr
        counts = dict(re.findall(r"^(\w+) +(\d+)$", done.stdout, re.MULTILINE))
        return {rule: int(n) for rule, n in counts.items() if rule not in ("reproduce", "table", "total")}

    def edit(self, file: str, *, add: str) -> None:
        """Add a line to a file."""
        path = self.root / file
        path.write_text(path.read_text() + add + "\n")


@dataclass(frozen=True)
class Installed:
    """A working directory, and the command `carigs` of an installed package."""

    packages: Path
    folder: Path

    def __call__(self, *arguments: str) -> subprocess.CompletedProcess:
        """Run `carigs` in the folder."""
        return subprocess.run(
            [sys.executable, "-m", "carigs", *arguments],
            cwd=self.folder,
            env={**os.environ, **environment(self.packages)},
            capture_output=True,
            text=True,
        )


def environment(packages: Path) -> dict[str, str]:
    """Environment variables of processes that import the packages of a folder, and keep their bytecode there."""
    return {"PYTHONPATH": str(packages), "PYTHONDONTWRITEBYTECODE": ""}


def copy_project(folder: Path) -> Project:
    """The project as it is in this checkout."""
    for name in ("Snakefile", "environment.yml"):
        shutil.copy2(ROOT / name, folder / name)
    for name in ("workflow", "profiles", "conf", "carigs", "evaluation"):
        shutil.copytree(ROOT / name, folder / name, ignore=NO_CACHES)
    return Project(folder)


def copy_packages(folder: Path) -> None:
    """The files of the wheel, as pyproject.toml lists them."""
    wheel = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["wheel"]
    moved = {**{name: name for name in wheel["packages"]}, **wheel["force-include"]}
    for source, target in moved.items():
        if (ROOT / source).is_dir():
            shutil.copytree(ROOT / source, folder / target, ignore=NO_CACHES)
        else:
            shutil.copy2(ROOT / source, folder / target)


@contextmanager
def shared_kernels() -> Iterator[None]:
    """Within it, processes that import a copy of the packages use the compiled kernels of this checkout."""
    before = os.environ.get("NUMBA_CACHE_DIR")
    os.environ["NUMBA_CACHE_DIR"] = str(kernel_folder().parent)
    try:
        yield
    finally:
        if before is None:
            del os.environ["NUMBA_CACHE_DIR"]
        else:
            os.environ["NUMBA_CACHE_DIR"] = before
