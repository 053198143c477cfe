"""The stages of the workflow as a drawing, with an arrow from each stage to those that need its files.

Example:
    snakemake --rulegraph -- reproduce table | python -m evaluation.figures.data_flow data_flow.svg
"""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from carigs.errors import InputError
from carigs.system.files import writing
from evaluation.command_line import run


class Box(NamedTuple):
    """Where a stage is drawn, and what it writes."""

    column: int
    row: int
    files: str


BOXES = {
    "dataset": Box(1, 0, "images, mattes, cameras"),
    "capture": Box(1, 1, "capture.json"),
    "hair": Box(0, 2, "hair.npz"),
    "exaggerate": Box(2, 2, "path.npz"),
    "gtstar": Box(1, 3, "targets/"),
    "train": Box(1, 4, "avatar.npz"),
    "target_sheet": Box(0, 4, "inspection.png"),
    "html": Box(0, 5, "avatar.html"),
    "render": Box(1, 5, "frames/"),
    "truth": Box(2, 5, "truth/"),
    "figures": Box(1, 6, "figures/"),
    "metrics": Box(2, 6, "metrics.csv"),
    "tabulate": Box(2, 7, "table/"),
    "report": Box(0, 8, "report.html"),
    "card": Box(2, 8, "card.md, card.json"),
}
"""The stages, and the input of the first one, from top to bottom."""
LEFT_OUT = {"settings", "table", "reproduce"}
"""Rules of the workflow that are no stages."""
WIDTH, HEIGHT, COLUMN, ROW, MARGIN = 200, 52, 250, 88, 10
"""Size of a box, its distance to the next one, and the margin, in pixels."""
_NODE, _LINK = re.compile(r"(\d+)\[label = \"(\w+)\""), re.compile(r"(\d+) -> (\d+)")

Link = tuple[str, str]


def read_links(graph: str) -> set[Link]:
    """Links between stages in a graph of rules.

    Args:
        graph: What `snakemake --rulegraph` prints.

    Returns:
        Pairs of a stage and one that reads its files.

    Raises:
        InputError: If the graph has no links, or a stage that has no place in the drawing.
    """
    names = dict(_NODE.findall(graph))
    links = {(names[a], names[b]) for a, b in _LINK.findall(graph)}
    links = {link for link in links if not LEFT_OUT & {*link}}
    unknown = {name for link in links for name in link} - {*BOXES}
    if unknown or not links:
        problem = f"no place for {', '.join(sorted(unknown))}" if unknown else "no stages in the graph"
        raise InputError(problem, file="stdin")
    return links


def without_detours(links: Iterable[Link]) -> set[Link]:
    """Leave out links that follow from others: the transitive reduction of a graph without cycles.

    Args:
        links: Pairs of a stage and one that needs it.

    Returns:
        The least links with the same paths.
    """
    after: dict[str, set[str]] = {}
    for a, b in links:
        after.setdefault(a, set()).add(b)

    def reached(a: str) -> set[str]:
        return {c for b in after.get(a, ()) for c in (b, *reached(b))}

    return {(a, b) for a in after for b in after[a] if not any(b in reached(c) for c in after[a])}


def drawing(links: Iterable[Link]) -> str:
    """Draw the stages.

    Args:
        links: Pairs of a stage and one that needs it.

    Returns:
        Text of an SVG file.
    """
    width = 2 * COLUMN + WIDTH + 2 * MARGIN
    height = max(box.row for box in BOXES.values()) * ROW + HEIGHT + 2 * MARGIN
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {height}" width="{width}" height="{height}" '
        'font-family="system-ui, sans-serif" role="img" aria-label="Stages of the workflow">',
        '<defs><marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="8" markerHeight="8" orient="auto">'
        '<path d="M0,0 L8,4 L0,8 z" fill="#5b6478"/></marker></defs>',
        f'<rect width="{width}" height="{height}" fill="#ffffff"/>',
        '<g fill="none" stroke="#5b6478" stroke-width="1.5" marker-end="url(#tip)">',
        *(f'<path d="{_curve(BOXES[a], BOXES[b])}"/>' for a, b in sorted(links)),
        "</g>",
        '<g text-anchor="middle">',
    ]
    for name, box in BOXES.items():
        x, y = _corner(box)
        fill, line = ("#f2f3f7", "#8a92a6") if box.row == 0 else ("#e8ebfa", "#3f51b5")
        centre = x + WIDTH // 2
        lines += [
            f'<rect x="{x}" y="{y}" width="{WIDTH}" height="{HEIGHT}" rx="8" fill="{fill}" stroke="{line}"/>',
            f'<text x="{centre}" y="{y + 22}" font-size="16" font-weight="600" fill="#1a237e">{name}</text>',
            f'<text x="{centre}" y="{y + 42}" font-size="13" fill="#333a4d">{box.files}</text>',
        ]
    return "\n".join([*lines, "</g>", "</svg>", ""])


def _corner(box: Box) -> tuple[int, int]:
    return MARGIN + box.column * COLUMN, MARGIN + box.row * ROW


def _curve(start: Box, end: Box) -> str:
    """From the lower edge of a box to the upper edge of one below it, or from side to side in a row."""
    (x0, y0), (x1, y1) = _corner(start), _corner(end)
    if start.row == end.row:
        y, rightward = y0 + HEIGHT // 2, x1 > x0
        return f"M{x0 + WIDTH * rightward},{y} L{x1 + WIDTH * (not rightward)},{y}"
    x0, x1, y0 = x0 + WIDTH // 2, x1 + WIDTH // 2, y0 + HEIGHT
    # Arrows from the left arrive left of the middle, so that those into one box stay apart.
    x1 += 30 * ((x0 > x1) - (x0 < x1))
    middle = (y0 + y1) // 2
    return f"M{x0},{y0} C{x0},{middle} {x1},{middle} {x1},{y1}"


def main() -> None:
    """Draw the graph of rules that is read from standard input."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path, help="SVG file to write")
    file = parser.parse_args().file
    links = without_detours({("dataset", "capture"), *read_links(sys.stdin.read())})
    with writing(file) as part:
        part.write_text(drawing(links), "utf-8")


if __name__ == "__main__":
    run(main)
