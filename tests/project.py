"""A copy of the project in a folder of its own, and its command line."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]


@dataclass(frozen=True)
class Project:
    """A folder with the project, and its command line."""

    root: Path

    def start(self, *command: str) -> subprocess.Popen:
        """Start `python -m ...` in the project, as a process group; of this checkout only the environment is used."""
        return subprocess.Popen(
            [sys.executable, "-m", *command],
            cwd=self.root,
            env={**os.environ, "PYTHONPATH": str(self.root)},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def command(self, *command: str) -> subprocess.CompletedProcess:
        """Run `python -m ...` in the project."""
        running = self.start(*command)
        output, errors = running.communicate()
        return subprocess.CompletedProcess(command, running.returncode, output, errors)

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


def copy_project(folder: Path) -> Project:
    """The project as it is in this checkout."""
    ignore = shutil.ignore_patterns("*.pyc")  # but with Numba's cache
    for name in ("Snakefile", "environment.yml"):
        shutil.copy2(ROOT / name, folder / name)
    for name in ("workflow", "profiles", "conf", "carigs", "evaluation"):
        shutil.copytree(ROOT / name, folder / name, ignore=ignore)
    return Project(folder)
