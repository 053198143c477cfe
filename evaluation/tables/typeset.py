"""The comparison tables as Markdown and LaTeX: table 1 of the paper, and PSNR by region."""

from __future__ import annotations

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from carigs.settings import Tabulate
from evaluation.tables.metric_records import REGIONS

NO_VALUE = "—"
COLUMNS = {
    "CLIP-I": ("test", "clip_i_cos"),
    "CLIP-I (2.5 x)": ("test", "clip_i_score_w2.5"),
    "CLIP-D": ("test", "clip_d"),
    "CLIP-C": ("orbit", "clip_c_adjacent"),
    "DINO": ("test", "dino_vitb8_cls"),
    "PSNR": ("test", "psnr"),
    "SSIM": ("test", "ssim"),
}
"""Protocol and metric of each column of table 1."""
NOVEL_VIEW = {"PSNR": ("val", "psnr"), "SSIM": ("val", "ssim")}


@dataclass(frozen=True)
class Table:
    """A table of texts; the first cell of each line names it."""

    title: str
    header: list[str]
    body: list[list[str]]


@dataclass
class Document:
    """Tables, and the reasons for their missing values as notes (a), (b), ..."""

    settings: Tabulate
    tables: list[Table] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)

    @property
    def explanation(self) -> str:
        """Description of the numbers."""
        return (
            f"Means over frames with {self.settings.confidence:.0%} bootstrap intervals (percentile, "
            f"{self.settings.resamples} resamples; subjects, timesteps and cameras resampled). PSNR in dB. "
            "n: number of frames. Higher is better."
        )

    @property
    def notes(self) -> list[str]:
        """Reasons with their letters."""
        return [f"({_letter(i)}) {reason}" for i, reason in enumerate(self.reasons)]

    def add(
        self, title: str, lines: Sequence[str], columns: Mapping[str, tuple], summaries: pd.DataFrame, keys: list[str]
    ) -> None:
        """Append a table.

        Args:
            title: Its title.
            lines: Names of its lines.
            columns: Names of its columns, each with the rest of the key of its cells.
            summaries: Means and intervals, with the columns `evaluation.tables.summary.SUMMARY`.
            keys: Columns of `summaries` that make the key of a cell: the one of the line first.
        """
        cells: dict[Hashable, Any] = dict(
            zip(zip(*(summaries[key] for key in keys), strict=True), summaries.itertuples(), strict=True)
        )
        header = [""]
        for name, key in columns.items():
            counts = sorted({cell.n for line in lines if (cell := cells.get((line, *key))) and cell.n})
            ends = dict.fromkeys((*counts[:1], *counts[-1:]))
            header.append(f"{name} (n={'-'.join(map(str, ends))})" if counts else name)
        body = [[line, *(self._text(cells.get((line, *key))) for key in columns.values())] for line in lines]
        self.tables.append(Table(title, header, body))

    def _text(self, cell: Any) -> str:
        if cell is None:
            return NO_VALUE
        if pd.isna(cell.mean):
            if cell.reason not in self.reasons:
                self.reasons.append(cell.reason)
            return f"{NO_VALUE} ({_letter(self.reasons.index(cell.reason))})"
        digits = self.settings.digits if cell.metric == "psnr" else self.settings.digits + 2
        pattern = f"{{:{'+' if cell.minus else ''}.{digits}f}}"
        ends = "" if pd.isna(cell.low) else f" [{pattern}, {pattern}]".format(cell.low, cell.high)
        return pattern.format(cell.mean) + ends


def comparison_tables(summaries: pd.DataFrame, settings: Tabulate) -> Document:
    """Build the readable tables of a study.

    Table 1 of the paper (variants x metrics) at each level, and PSNR by region with paired differences at the highest
    level that has a truth.

    Args:
        summaries: Means and intervals, with the columns `evaluation.tables.summary.SUMMARY`.
        settings: Settings of the stage `tabulate`.

    Returns:
        The tables and notes.
    """
    document = Document(settings)
    for (study, gamma), here in summaries.groupby(["study", "gamma"]):
        title = f"{study}, trained for gamma {gamma:g}"
        for level, means in here[here["minus"] == ""].groupby("level"):
            variants, whole = sorted(set(means["variant"])), means[means["region"] == "full"]
            keys = ["variant", "protocol", "metric"]
            document.add(f"{title}, level {level:g}", variants, COLUMNS, whole, keys)
            if (means["protocol"] == "val").any():
                document.add(f"{title}, level {level:g}, novel view", variants, NOVEL_VIEW, whole, keys)
        psnr = here[(here["metric"] == "psnr") & (here["protocol"] == "test")]
        level = psnr["level"][psnr["mean"].notna()].max()
        if pd.notna(level):
            title = f"{title}, level {level:g}: PSNR by region"
            _add_regions(document, title, psnr[psnr["level"] == level], settings.reference)
    return document


def to_markdown(document: Document) -> str:
    """Format tables as GitHub Markdown.

    Args:
        document: Tables and notes.

    Returns:
        The text.
    """
    parts = [document.explanation + "\n"]
    for table in document.tables:
        lines = [table.header, ["---"] * len(table.header), *table.body]
        body = "\n".join("| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in lines)
        parts.append(f"### {table.title}\n\n{body}\n")
    parts += [f"{note}\n" for note in document.notes]
    return "\n".join(parts)


def to_latex(document: Document) -> str:
    """Format tables as LaTeX floats, which need the package booktabs.

    Args:
        document: Tables and notes.

    Returns:
        The text.
    """
    parts = [f"{_escape(document.explanation)}\n"]
    for table in document.tables:
        header, *body = [" & ".join(_escape(cell) for cell in line) + r" \\" for line in (table.header, *table.body)]
        lines = [
            r"\begin{table}",
            r"\centering\small",
            rf"\caption{{{_escape(table.title)}}}",
            rf"\begin{{tabular}}{{l{'c' * (len(table.header) - 1)}}}",
            *(r"\toprule", header, r"\midrule", *body, r"\bottomrule"),
            r"\end{tabular}",
            r"\end{table}",
        ]
        parts.append("\n".join(lines) + "\n")
    parts += [f"{_escape(note)}\n" for note in document.notes]
    return "\n".join(parts)


def _add_regions(document: Document, title: str, psnr: pd.DataFrame, reference: str) -> None:
    keys = ["region", "variant", "minus"]
    document.add(title, REGIONS, {variant: (variant, "") for variant in sorted(set(psnr["variant"]))}, psnr, keys)
    differences = {f"minus {variant}": (reference, variant) for variant in sorted(set(psnr["minus"]) - {""})}
    if differences:
        document.add(f"{title}, {reference} minus the others, paired by frame", REGIONS, differences, psnr, keys)


def _letter(i: int) -> str:
    return "abcdefghijklmnopqrstuvwxyz"[i % 26] * (1 + i // 26)


_LATEX = {
    **{character: f"\\{character}" for character in "_%&#${}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    NO_VALUE: "---",
}


def _escape(text: str) -> str:
    return "".join(_LATEX.get(character, character) for character in text)
