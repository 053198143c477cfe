"""Which of the faults of `planted_faults.toml` do the fast tests notice?

`python tests/planted_faults.py [NAME ...]` plants one fault after the other, all if none is named, into a copy of this
checkout. It runs the tests that should notice it, then all fast ones, until a test fails, and prints that test. It ends
with the number of faults that were noticed; the status is 1 if one was not.

There is one copy, where each fault is undone before the next one is planted: so the compiled kernels of this checkout,
which the copy begins with, serve all faults outside of kernels.
"""

from __future__ import annotations

import importlib.util
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
LIST = Path(__file__).with_suffix(".toml")
FAST = "not (slow or docs or browser or chaos or slurm or s3)"
"""What `make test` runs."""
NO_TESTS = 5
"""Status of pytest if it found no test."""


@dataclass(frozen=True)
class Fault:
    """A slip of a developer, as an edit of one file."""

    name: str
    meaning: str
    file: str
    old: str
    """Text that stands once in the file."""
    new: str
    tests: list[str]
    """Folders of tests that should notice it."""

    def planted(self, root: Path = ROOT) -> str:
        """The text of the file with the fault; ValueError if `old` does not stand in it exactly once."""
        text = (root / self.file).read_text("utf-8")
        if (count := text.count(self.old)) != 1:
            raise ValueError(f"{self.name}: found {count} times in {self.file}, expected once: {self.old.strip()}")
        return text.replace(self.old, self.new)


def read_faults(file: Path = LIST) -> list[Fault]:
    """The faults of a list."""
    return [Fault(name, **entry) for name, entry in tomllib.loads(file.read_text("utf-8")).items()]


def copy_checkout(target: Path) -> None:
    """Copy the files that git tracks, and compiled kernels."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, text=True, check=True).stdout
    for name in filter(None, listed.split("\0")):
        (target / name).parent.mkdir(parents=True, exist_ok=True)
        if (ROOT / name).is_file():
            shutil.copy2(ROOT / name, target / name)
    kernels = ROOT / "carigs/__pycache__"
    if kernels.is_dir():
        shutil.copytree(kernels, target / "carigs/__pycache__", dirs_exist_ok=True)


def write_source(file: Path, text: str) -> None:
    """Write a file, and forget its bytecode: Python compares sizes and whole seconds, which may stay the same."""
    file.write_text(text, "utf-8")
    Path(importlib.util.cache_from_source(str(file))).unlink(missing_ok=True)


def first_failure(root: Path, tests: list[str]) -> str:
    """The first fast test of a checkout that fails, empty if all pass; `tests` are folders, all if empty."""
    environment = os.environ | {"PYTHONPATH": str(root)}
    command = [sys.executable, "-m", "pytest", "-x", "-m", FAST, "-p", "no:cacheprovider", *tests]
    done = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, check=False)
    if done.returncode in (0, NO_TESTS):
        return ""
    found = re.findall(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)
    return found[-1] if found else f"pytest ended with {done.returncode}: {(done.stderr or done.stdout)[-200:]}"


def main(names: list[str]) -> int:
    """Plant the named faults, and print which test notices each."""
    faults = [fault for fault in read_faults() if not names or fault.name in names]
    if unknown := set(names) - {fault.name for fault in faults}:
        raise SystemExit(f"no fault {', '.join(sorted(unknown))} in {LIST.name}")
    noticed = 0
    with tempfile.TemporaryDirectory(prefix="carigs-faults-") as folder:
        root = Path(folder)
        copy_checkout(root)
        for fault in faults:
            file = root / fault.file
            sound, broken = file.read_text("utf-8"), fault.planted(root)
            write_source(file, broken)
            test = first_failure(root, fault.tests) or first_failure(root, [])
            write_source(file, sound)
            noticed += bool(test)
            print(f"{fault.name:28}{test or 'not noticed: ' + fault.meaning}", flush=True)
    print(f"{noticed} of {len(faults)} faults noticed")
    return int(noticed < len(faults))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
