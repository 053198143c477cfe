"""Faults of a capture: errors and findings of one kind, with where they are and how they are mended."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

from carigs.errors import InputError
from carigs.plausibility.findings import Finding

OTHERWISE = "mend the field, or remove its frames from transforms_*.json"
"""What to do about errors that have no remedy."""


class Fault(NamedTuple):
    """What is wrong, and everywhere it is wrong."""

    problem: str
    places: tuple[str, ...]
    """Files and fields, the worst first, with their own numbers where these differ."""
    remedy: str


def error_faults(errors: Iterable[InputError], folder: Path) -> list[Fault]:
    """Group errors by their messages, numbers aside.

    Args:
        errors: The errors.
        folder: Paths are shortened to those in it.

    Returns:
        Faults in the order of their first errors, each with the remedy of that error.
    """
    kinds: dict[str, list[InputError]] = {}
    for error in errors:
        kinds.setdefault(re.sub(r"[-+]?\d[\d.e+-]*|'[^']*'|\S*[/\\]\S*", "#", error.problem), []).append(error)
    faults = []
    for members in kinds.values():
        places = []
        for error in members:
            own = "" if error.problem == members[0].problem else error.problem
            places.append(_place(Path(error.file), error.field or "", own, folder))
        first = members[0]
        faults.append(Fault(first.problem, tuple(dict.fromkeys(places)), first.remedy or OTHERWISE))
    return faults


def finding_faults(findings: Sequence[Finding], folder: Path) -> list[Fault]:
    """Group findings by their kind.

    Args:
        findings: The findings.
        folder: Paths are shortened to those in it.

    Returns:
        Faults in the order of their first findings, each with the remedy of its worst finding.
    """
    kinds: dict[str, list[Finding]] = {}
    for finding in findings:
        kinds.setdefault(finding.kind, []).append(finding)
    faults = []
    for kind, members in kinds.items():
        worst = sorted(members, key=lambda finding: -finding.size)
        places = tuple(_place(f.file, f.field, f.details, folder) for f in worst)
        faults.append(Fault(kind, places, worst[0].remedy))
    return faults


def _place(file: Path, field: str, details: str, folder: Path) -> str:
    name = "." if file == folder else str(file.relative_to(folder) if file.is_relative_to(folder) else file)
    where = f"{name}: {field}" if field else name
    return f"{where}: {details}" if details else where
