"""The table of a report, in Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

CHECKS = "checks"
"""Part whose figures are tests: the table counts them."""


def table(parts: Sequence[dict[str, Any]]) -> str:
    """Write a report as a table.

    Args:
        parts: Results of `run_part`.

    Returns:
        Markdown: a row for each figure, and one for each part that did not end well.
    """
    rows = ["| part | what | quantity | value |", "|---|---|---|---:|"]
    for part in parts:
        if part["part"] == CHECKS:
            rows += [f"| {CHECKS} | tests | {end} | {count} |" for end, count in _ends(part["figures"]).items()]
        else:
            rows += [_row(part["part"], figure) for figure in part["figures"]]
        if part["end"] != "done":
            rows.append(f"| {part['part']} | **{part['end']}** | {part['why'].replace('|', ';')} | |")
    return "\n".join(rows)


def _ends(figures: Sequence[dict[str, Any]]) -> dict[str, int]:
    ends = [str(figure["value"]).partition(":")[0] for figure in figures]
    return {end: ends.count(end) for end in dict.fromkeys(ends)}


def _row(part: str, figure: dict[str, Any]) -> str:
    value = figure["value"] if isinstance(figure["value"], str) else f"{figure['value']:.4g}"
    return f"| {part} | {figure['case']} | {figure['quantity']} | {' '.join([value, figure['unit']]).rstrip()} |"
