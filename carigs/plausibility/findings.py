"""Findings: what is likely to be wrong, where, and how badly; findings of one kind become one line."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple


class Finding(NamedTuple):
    """Something that is likely to be wrong."""

    kind: str
    """What is wrong, in words that hold for every finding of the kind."""
    file: Path
    field: str
    """Array, key, camera or frame; may be empty."""
    details: str
    """Numbers of this finding."""
    remedy: str
    """What to do about it."""
    size: float = 0.0
    """How wrong it is: the largest one is shown."""


def summarize(findings: Iterable[Finding]) -> tuple[str, ...]:
    """Write one line per kind of finding.

    Args:
        findings: The findings.

    Returns:
        Lines `file: field: problem; remedy` of the worst finding of each kind, with the number of the others.
    """
    kinds: dict[str, list[Finding]] = {}
    for finding in findings:
        kinds.setdefault(finding.kind, []).append(finding)
    lines = []
    for kind, members in kinds.items():
        worst = max(members, key=lambda finding: finding.size)
        where = f"{worst.file}: {worst.field}" if worst.field else f"{worst.file}"
        others = f"; {len(members) - 1} more like this" if len(members) > 1 else ""
        lines.append(f"{where}: {kind} ({worst.details}{others}); remedy: {worst.remedy}")
    return tuple(lines)
