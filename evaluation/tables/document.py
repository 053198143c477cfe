"""Tables with notes, as Markdown and LaTeX."""

from __future__ import annotations

import re
from dataclasses import dataclass, field
from typing import NamedTuple

NO_VALUE = "—"
LATEX = str.maketrans(
    {character: f"\\{character}" for character in "_%&#${}"}
    | {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", NO_VALUE: "---"}
    | {"↑": r"$\uparrow$", "↓": r"$\downarrow$", "<": r"$<$", ">": r"$>$"}
)
"""What LaTeX needs in place of a character."""


class Cell(NamedTuple):
    """Value of a table, with its interval and what else is said of it."""

    value: str
    interval: str = ""
    note: str = ""
    best: bool = False


@dataclass
class Table:
    """Lines of cells under a header, in blocks with a heading each."""

    title: str
    header: list[str]
    """Headings of the columns, without that of the lines."""
    blocks: list[tuple[str, list[tuple[str, list[Cell]]]]] = field(default_factory=list)
    """Heading, which may be empty, and lines: their name and cells."""


@dataclass
class Document:
    """Tables with an explanation and notes."""

    explanation: list[str] = field(default_factory=list)
    """Paragraphs above the tables."""
    tables: list[Table] = field(default_factory=list)
    reasons: dict[str, int] = field(default_factory=dict)
    """Reasons for missing values, numbered: notes (a), (b), ..."""
    definitions: list[str] = field(default_factory=list)
    """What the columns are, below the tables."""

    def note(self, reason: str) -> str:
        """Number a reason, without the paths of the machine in it.

        Args:
            reason: Reason for a missing value.

        Returns:
            The mark of its note: (a), (b), ...
        """
        return f"({_letter(self.reasons.setdefault(without_paths(reason), len(self.reasons)))})"

    @property
    def notes(self) -> list[str]:
        """Reasons with their marks, then the definitions."""
        return [*(f"({_letter(i)}) {reason}" for reason, i in self.reasons.items()), *self.definitions]


def without_paths(text: str) -> str:
    """Leave out the paths of a machine, which say nothing on another one and may name its user.

    Args:
        text: A message, such as the reason for a missing value.

    Returns:
        The text without " in FOLDER, FOLDER ..."; of other absolute paths the last part remains. URLs are kept.
    """
    absolute = r"(?<![\w:/\\.])(?:~|[A-Za-z]:(?=\\))?[/\\](?=\S)"
    text = re.sub(rf" in (?:[^;]*?, )?{absolute}[^;]*", "", text)
    return re.sub(rf"{absolute}(?:[^\s;,:]*[/\\])?([^\s;,:/\\]*)", r"\1", text)


def to_markdown(document: Document) -> str:
    """Format tables as GitHub Markdown.

    Args:
        document: Tables and notes.

    Returns:
        The text.
    """
    parts = [f"{paragraph}\n" for paragraph in document.explanation]
    for table in document.tables:
        lines = [["", *table.header], ["---"] * (1 + len(table.header))]
        for heading, block in table.blocks:
            if heading:
                lines.append([f"*{heading}*", *[""] * len(table.header)])
            lines += [[name, *map(_markdown_cell, cells)] for name, cells in block]
        text = "\n".join("| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in lines)
        parts.append(f"### {table.title}\n\n{text}\n")
    parts += [f"{note}\n" for note in document.notes]
    return "\n".join(parts)


def to_latex(document: Document) -> str:
    """Format tables as LaTeX floats over both columns, which need the package booktabs.

    Args:
        document: Tables and notes.

    Returns:
        The text.
    """
    parts = [f"{paragraph}\n".translate(LATEX) for paragraph in document.explanation]
    for table in document.tables:
        columns = len(table.header)
        header = " & ".join(["", *(_stacked(*_halves(name.translate(LATEX))) for name in table.header)])
        lines = [
            r"\begin{table*}",
            r"\centering\footnotesize",
            r"\setlength{\tabcolsep}{3.5pt}",
            rf"\caption{{{table.title.translate(LATEX)}}}",
            rf"\begin{{tabular}}{{@{{}}l{'c' * columns}@{{}}}}",
            *(r"\toprule", rf"{header} \\"),
        ]
        for heading, block in table.blocks:
            lines.append(r"\midrule")
            if heading:
                lines.append(rf"\multicolumn{{{columns + 1}}}{{@{{}}l}}{{\emph{{{heading.translate(LATEX)}}}}} \\")
            for name, cells in block:
                lines.append(" & ".join([name.translate(LATEX), *map(_latex_cell, cells)]) + r" \\")
        lines += [r"\bottomrule", r"\end{tabular}", r"\end{table*}"]
        parts.append("\n".join(lines) + "\n")
    parts += [f"{note}\n".translate(LATEX) for note in document.notes]
    return "\n".join(parts)


def _markdown_cell(cell: Cell) -> str:
    value = f"**{cell.value}**" if cell.best else cell.value
    return " ".join(filter(None, (value, cell.interval, cell.note)))


def _latex_cell(cell: Cell) -> str:
    value, interval, note = (text.translate(LATEX) for text in (cell.value, cell.interval, cell.note))
    value = rf"\textbf{{{value}}}" if cell.best else value
    return _stacked(value, " ".join(filter(None, (interval, note))))


def _stacked(above: str, below: str) -> str:
    """Two lines in a cell, the lower one small."""
    return rf"\shortstack{{{above}\\{{\scriptsize {below}}}}}" if below else above


def _halves(heading: str) -> tuple[str, str]:
    """A heading, and what stands in brackets behind it."""
    above, bracket, below = heading.partition(" (")
    return above, f"({below}" if bracket else ""


def _letter(i: int) -> str:
    return "abcdefghijklmnopqrstuvwxyz"[i % 26] * (1 + i // 26)
