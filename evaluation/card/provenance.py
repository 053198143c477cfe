"""What a card was made with: the machine, the versions of packages, the commit, and seeds."""

from __future__ import annotations

import os
import platform
import re
import subprocess
from collections.abc import Iterator, Mapping
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path
from typing import Any

import psutil

OF_A_STUDY = re.compile(r"([\w.-]+)(?:(?!extra ==).)*(?:extra == .(?:avatar|study).)?")
"""A requirement in the metadata of carigs that every installation, or that of a study, fulfils."""


def machine() -> dict[str, Any]:
    """The processor, cores and memory of this machine; neither its name nor a path.

    Returns:
        The fields processor, cores, memory_gb and system.
    """
    return {
        "processor": _processor(),
        "cores": os.cpu_count(),
        "memory_gb": round(psutil.virtual_memory().total / 2**30, 1),
        "system": f"{platform.system()} {platform.machine()}",
    }


def versions() -> dict[str, str]:
    """Versions of Python, carigs and the packages that a study needs.

    Returns:
        Versions by name of the package.
    """
    needed = filter(None, map(OF_A_STUDY.fullmatch, requires("carigs") or ()))
    names = sorted({requirement[1] for requirement in needed})
    found = {"python": platform.python_version()}
    for name in ("carigs", *names):
        try:
            found[name] = version(name)
        except PackageNotFoundError:  # not needed on this platform
            continue
    return found


def commit(root: Path) -> dict[str, Any]:
    """The commit of a checkout.

    Args:
        root: Folder of the project.

    Returns:
        The fields id, modified (whether files differ from the commit) and reason; id is None outside of a checkout.
    """
    if not (root / ".git").exists():
        return {"id": None, "modified": None, "reason": "not a checkout: an installed package"}
    try:
        identity = _git(root, "rev-parse", "HEAD").strip()
        modified = bool(_git(root, "status", "--porcelain", "--untracked-files=no").strip())
    except (OSError, subprocess.SubprocessError):
        return {"id": None, "modified": None, "reason": "git cannot read the checkout"}
    return {"id": identity, "modified": modified, "reason": ""}


def find_seeds(settings: Mapping[str, Any], at: str = "") -> Iterator[tuple[str, int]]:
    """Find the seeds in settings.

    Args:
        settings: A section, or sections by name.
        at: Name of the mapping.

    Yields:
        Place and value of every key `seed`.
    """
    for key, value in settings.items():
        place = f"{at}.{key}" if at else str(key)
        if isinstance(value, Mapping):
            yield from find_seeds(value, place)
        elif key == "seed":
            yield place, value


def _processor() -> str:
    """Name of the processor; the platform module of Linux does not know it."""
    try:
        text = Path("/proc/cpuinfo").read_text("utf-8", "replace")
    except OSError:
        text = ""
    found = re.search(r"^model name\s*:\s*(.+)$", text, re.MULTILINE)
    return found[1].strip() if found else platform.processor() or platform.machine()


def _git(root: Path, *arguments: str) -> str:
    command = ["git", "-C", str(root), "--no-optional-locks", *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, timeout=20).stdout
