"""The comparison tables as Markdown and LaTeX: table 1 of the paper, and PSNR by region."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
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
LATEX = str.maketrans(
    {character: f"\\{character}" for character in "_%&#${}"}
    | {"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", NO_VALUE: "---"}
)
"""What LaTeX needs in place of a character."""
NOVEL_VIEW = {"PSNR": ("val", "psnr"), "SSIM": ("val", "ssim")}


@dataclass
class Document:
    """Comparison tables with an explanation and notes."""

    explanation: str
    tables: list[tuple[str, list[list[str]]]] = field(default_factory=list)
    """Title and cells of each table; the first line is the header, the first cell of each line its name."""
    reasons: dict[str, int] = field(default_factory=dict)
    """Reasons for missing values, numbered: notes (a), (b), ..."""

    @property
    def notes(self) -> list[str]:
        """Reasons with their letters."""
        return [f"({_letter(i)}) {reason}" for reason, i in self.reasons.items()]


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
    splits = "; ".join(sorted(set(summaries["split"])))
    document = Document(
        f"Means over frames with {settings.confidence:.0%} bootstrap intervals (percentile, {settings.resamples} "
        "resamples; subjects, timesteps and cameras resampled). PSNR in dB. n: number of frames. Higher is better. "
        f"Split: {splits}."
    )

    def add(title: str, lines: Sequence[str], columns: Mapping[str, tuple], subset: pd.DataFrame, *keys: str) -> None:
        """Append a table; `keys` are the columns of `subset` that identify a cell: first its line, then its column."""
        cells = {tuple(getattr(s, key) for key in keys): s for s in subset.itertuples()}
        header = [""]
        for name, key in columns.items():
            counts = sorted({cell.n for line in lines if (cell := cells.get((line, *key))) and cell.n})
            ends = dict.fromkeys((*counts[:1], *counts[-1:]))
            header.append(f"{name} (n={'-'.join(map(str, ends))})" if counts else name)
        body = [[line, *(_text(cells.get((line, *key)), document.reasons, settings.digits) for key in columns.values())]
                for line in lines]  # fmt: skip
        document.tables.append((title, [header, *body]))

    for (study, gamma), here in summaries.groupby(["study", "gamma"]):
        title = f"{study}, trained for gamma {gamma:g}"
        for level, means in here[here["minus"] == ""].groupby("level"):
            at_level, variants = f"{title}, level {level:g}", sorted(set(means["variant"]))
            whole = means[means["region"] == "full"]
            add(at_level, variants, COLUMNS, whole, "variant", "protocol", "metric")
            if (means["protocol"] == "val").any():
                add(f"{at_level}, novel view", variants, NOVEL_VIEW, whole, "variant", "protocol", "metric")
        psnr = here[(here["metric"] == "psnr") & (here["protocol"] == "test")]
        level = psnr["level"][psnr["mean"].notna()].max()
        if pd.isna(level):
            continue
        psnr, title = psnr[psnr["level"] == level], f"{title}, level {level:g}: PSNR by region"
        columns = {variant: (variant, "") for variant in sorted(set(psnr["variant"]))}
        add(title, REGIONS, columns, psnr, "region", "variant", "minus")
        columns = {f"minus {name}": (settings.reference, name) for name in sorted(set(psnr["minus"]) - {""})}
        if columns:
            title += f", {settings.reference} minus the others, paired by frame"
            add(title, REGIONS, columns, psnr, "region", "variant", "minus")
    return document


def to_markdown(document: Document) -> str:
    """Format tables as GitHub Markdown.

    Args:
        document: Tables and notes.

    Returns:
        The text.
    """
    parts = [document.explanation + "\n"]
    for title, (header, *body) in document.tables:
        lines = [header, ["---"] * len(header), *body]
        text = "\n".join("| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in lines)
        parts.append(f"### {title}\n\n{text}\n")
    parts += [f"{note}\n" for note in document.notes]
    return "\n".join(parts)


def to_latex(document: Document) -> str:
    """Format tables as LaTeX floats, which need the package booktabs.

    Args:
        document: Tables and notes.

    Returns:
        The text.
    """
    parts = [f"{document.explanation}\n".translate(LATEX)]
    for title, cells in document.tables:
        header, *body = [" & ".join(cell.translate(LATEX) for cell in line) + r" \\" for line in cells]
        lines = [
            r"\begin{table}",
            r"\centering\small",
            rf"\caption{{{title.translate(LATEX)}}}",
            rf"\begin{{tabular}}{{l{'c' * (len(cells[0]) - 1)}}}",
            *(r"\toprule", header, r"\midrule", *body, r"\bottomrule"),
            r"\end{tabular}",
            r"\end{table}",
        ]
        parts.append("\n".join(lines) + "\n")
    parts += [f"{note}\n".translate(LATEX) for note in document.notes]
    return "\n".join(parts)


def _text(cell: Any, reasons: dict[str, int], digits: int) -> str:
    """Text of a cell; a new reason for a missing value is added to the reasons."""
    if cell is None:
        return NO_VALUE
    if pd.isna(cell.mean):
        return f"{NO_VALUE} ({_letter(reasons.setdefault(cell.reason, len(reasons)))})"
    pattern = f"{{:{'+' if cell.minus else ''}.{digits if cell.metric == 'psnr' else digits + 2}f}}"
    ends = "" if pd.isna(cell.low) else f" [{pattern}, {pattern}]".format(cell.low, cell.high)
    return pattern.format(cell.mean) + ends


def _letter(i: int) -> str:
    return "abcdefghijklmnopqrstuvwxyz"[i % 26] * (1 + i // 26)
