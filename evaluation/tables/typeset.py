"""The readable tables, as Markdown and as LaTeX: variants x metrics at each level, and PSNR by region."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field

from carigs.settings import Tabulate
from evaluation.metrics.regions import REGIONS
from evaluation.tables.table import Summary

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
NOVEL_VIEW = {"PSNR": ("val", "psnr"), "SSIM": ("val", "ssim")}


@dataclass(frozen=True)
class Grid:
    """A table of texts; the first column names the rows."""

    title: str
    head: list[str]
    rows: list[list[str]]


@dataclass
class Document:
    """Tables, and the reasons behind their dashes: note (a), (b), ..."""

    settings: Tabulate
    grids: list[Grid] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)

    @property
    def explanation(self) -> str:
        """What the numbers are."""
        return (
            f"Means over frames with {self.settings.confidence:.0%} bootstrap intervals (percentile, "
            f"{self.settings.resamples} resamples; subjects, timesteps and cameras resampled). PSNR in dB. "
            "n: number of frames. Higher is better."
        )

    @property
    def notes(self) -> list[str]:
        """The reasons with their letters."""
        return [f"({_letter(i)}) {reason}" for i, reason in enumerate(self.reasons)]

    def add(self, title: str, lines: Sequence[str], columns: dict[str, object], find: Callable) -> None:
        """Append a table; `find(line, column's value)` is the Summary of a cell, or None."""
        cells = {(line, name): find(line, key) for line in lines for name, key in columns.items()}
        head = [""]
        for name in columns:
            counts = sorted({cell.n for line in lines if (cell := cells[line, name]) and cell.n})
            ends = dict.fromkeys((*counts[:1], *counts[-1:]))
            head.append(f"{name} (n={'-'.join(map(str, ends))})" if counts else name)
        rows = [[line, *(self._text(cells[line, name]) for name in columns)] for line in lines]
        self.grids.append(Grid(title, head, rows))

    def _text(self, cell: Summary | None) -> str:
        if cell is None:
            return NO_VALUE
        if cell.mean is None:
            if cell.reason not in self.reasons:
                self.reasons.append(cell.reason)
            return f"{NO_VALUE} ({_letter(self.reasons.index(cell.reason))})"
        digits = self.settings.digits if cell.metric == "psnr" else self.settings.digits + 2
        pattern = f"{{:{'+' if cell.minus else ''}.{digits}f}}"
        ends = "" if cell.low is None else f" [{pattern}, {pattern}]".format(cell.low, cell.high)
        return pattern.format(cell.mean) + ends


def document(summaries: Iterable[Summary], settings: Tabulate) -> Document:
    """One table per level, and PSNR by region with paired differences at the highest level that has a truth."""
    found = Document(settings)
    summaries = list(summaries)
    for study, gamma in sorted({(s.study, s.gamma) for s in summaries}):
        here = [s for s in summaries if (s.study, s.gamma) == (study, gamma)]
        title = f"{study}, trained for gamma {gamma:g}"
        for level in sorted({s.level for s in here}):
            _add_level(found, f"{title}, level {level:g}", [s for s in here if s.level == level and not s.minus])
        by_region = [s for s in here if (s.metric, s.protocol) == ("psnr", "test")]
        measured = {s.level for s in by_region if s.mean is not None}
        if measured:
            top = max(measured)
            _add_regions(found, f"{title}, level {top:g}: PSNR by region", [s for s in by_region if s.level == top])
    return found


def to_markdown(document: Document) -> str:
    """GitHub Markdown."""
    parts = [document.explanation + "\n"]
    for grid in document.grids:
        lines = [grid.head, ["---"] * len(grid.head), *grid.rows]
        body = "\n".join("| " + " | ".join(cell.replace("|", "/") for cell in line) + " |" for line in lines)
        parts.append(f"### {grid.title}\n\n{body}\n")
    parts += [f"{note}\n" for note in document.notes]
    return "\n".join(parts)


def to_latex(document: Document) -> str:
    """LaTeX floats (needs the package booktabs), then the notes."""
    parts = [f"{_escape(document.explanation)}\n"]
    for grid in document.grids:
        head, *rows = [" & ".join(_escape(cell) for cell in line) + r" \\" for line in (grid.head, *grid.rows)]
        lines = [
            r"\begin{table}",
            r"\centering\small",
            rf"\caption{{{_escape(grid.title)}}}",
            rf"\begin{{tabular}}{{l{'c' * (len(grid.head) - 1)}}}",
            *(r"\toprule", head, r"\midrule", *rows, r"\bottomrule"),
            r"\end{tabular}",
            r"\end{table}",
        ]
        parts.append("\n".join(lines) + "\n")
    parts += [f"{_escape(note)}\n" for note in document.notes]
    return "\n".join(parts)


def _add_level(found: Document, title: str, summaries: list[Summary]) -> None:
    cells = {(s.variant, s.protocol, s.metric): s for s in summaries if s.region == "full"}
    variants = sorted({s.variant for s in summaries})
    found.add(title, variants, COLUMNS, lambda variant, key: cells.get((variant, *key)))
    if any(s.protocol == "val" for s in summaries):
        found.add(f"{title}, novel view", variants, NOVEL_VIEW, lambda variant, key: cells.get((variant, *key)))


def _add_regions(found: Document, title: str, summaries: list[Summary]) -> None:
    cells = {(s.region, s.variant, s.minus): s for s in summaries}
    plain = {variant: (variant, "") for variant in sorted({s.variant for s in summaries})}
    minus = {f"minus {s.minus}": (s.variant, s.minus) for s in sorted(summaries, key=lambda s: s.minus) if s.minus}
    found.add(title, REGIONS, plain, lambda region, key: cells.get((region, *key)))
    if minus:
        title += f", {found.settings.reference} minus the others, paired by frame"
        found.add(title, REGIONS, minus, lambda region, key: cells.get((region, *key)))


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
