"""The comparison tables of a study: table 1 of the paper, our own metrics, single subjects, and PSNR by region."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import pandas as pd

from carigs.settings import Tabulate
from evaluation.tables.bootstrap import CONFIDENCE, MIN_LEVELS, RESAMPLES
from evaluation.tables.document import NO_VALUE, Cell, Document, Table
from evaluation.tables.factors import interval_scope
from evaluation.tables.metric import TABLES, Catalogue, Metric
from evaluation.tables.metric_records import REGIONS
from evaluation.tables.published import CAVEAT, PUBLISHED
from evaluation.tables.summary import ALL

ARROWS = {"higher": " ↑", "lower": " ↓", "neither": ""}
Key = tuple[str, str, str]
"""What a cell shows: a metric of the catalogue, a protocol and a region."""
Line = tuple[str, str, float, str, str]
"""Name of a line, and subject, level, variant and `minus` of its cells."""


def comparison_tables(summaries: pd.DataFrame, settings: Tabulate, catalogue: Catalogue) -> Document:
    """Build the readable tables of a study.

    Table 1 of the paper at gamma_f beside the published values; for every table of `TABLES` the differences to the
    reference at gamma_f and all levels; the same by subject, if there are several; and PSNR by region.

    Args:
        summaries: Means and intervals, with the columns `evaluation.tables.summary.SUMMARY`.
        settings: Settings of the stage `tabulate`.
        catalogue: The metrics; others are left out.

    Returns:
        The tables and notes.
    """
    if summaries.empty:  # a capture without held-out frames, and no orbit
        return Document(["No frame was rendered: there is nothing to measure."])
    document = Document(_explanation(summaries))
    for (study, gamma), here in summaries.groupby(["study", "gamma"]):
        tables = _StudyTables(document, catalogue, here, f"{study}, trained for gamma {gamma:g}", settings.reference)
        tables.add_all()
    shown = sorted(set(summaries["metric"]) & catalogue.keys(), key=list(catalogue).index)
    document.definitions += [f"{catalogue[name].title}: {catalogue[name].source}." for name in shown]
    document.definitions.append(CAVEAT)
    return document


def _explanation(summaries: pd.DataFrame) -> list[str]:
    return [
        f"Means over frames with {CONFIDENCE:.0%} confidence intervals of crossed random effects: bootstrap-t "
        f"of {RESAMPLES} resamples, or Student's t where a factor has fewer than {MIN_LEVELS} levels. "
        f"{interval_scope(sorted(set(summaries['subject']) - {ALL}), int(summaries['seeds'].max()))}",
        "↑: higher is better, ↓: lower is better, no arrow: values cannot be ranked by themselves. Bold: the best "
        "value, if the interval of its difference to every other variant, paired by frame and seed, excludes 0 (not "
        "corrected for the number of comparisons). In brackets in a heading: unit, frames, n, the number of rendered "
        "frames, and the number of seeds, if there are several.",
        f"Split: {'; '.join(sorted(set(summaries['split'])))}.",
    ]


class _StudyTables:
    """The tables of one study and gamma."""

    def __init__(
        self, document: Document, catalogue: Catalogue, summaries: pd.DataFrame, title: str, reference: str
    ) -> None:
        keys = ["metric", "protocol", "region", "subject", "level", "variant", "minus"]
        self.document, self.catalogue, self.title, self.reference = document, catalogue, title, reference
        self.cells = {tuple(getattr(s, key) for key in keys): s for s in summaries.itertuples()}
        self.variants = sorted(set(summaries["variant"]), key=lambda name: (name == reference, name))
        self.levels = sorted(set(summaries["level"]), reverse=True)
        self.subjects = sorted(set(summaries["subject"]))  # `ALL` is the first
        self.protocols = sorted(set(summaries["protocol"]))

    def add_all(self) -> None:
        """Append the tables to the document."""
        top, everyone = self.levels[0], self.subjects[0]
        paper = list(self._columns("paper", None))
        others = self.subjects[1:]
        own = (
            f"this study, {len(others)} subjects" if others else f"this study, {everyone}",
            self._lines(everyone, top),
        )
        self._add(f"{TABLES['paper']}, level {top:g}", paper, [own], PUBLISHED)
        if others:
            by_subject = [(subject, self._lines(subject, top)) for subject in others]
            self._add(f"{TABLES['paper']} by subject, level {top:g}", paper, by_subject)
        for kind, title in TABLES.items():
            for protocol in (None, *self.protocols):
                keys = [key for key in self._columns(kind, protocol) if self._has_records(key)]
                title_here = title if protocol is None else f"{title}, {protocol}"
                differences = self._differences(everyone, top)
                compared = [key for key in keys if any(self._found([key], line) for line in differences)]
                title_of_differences = (
                    f"{title_here}, level {top:g}: {self.reference} minus the others, paired by frame"
                )
                self._add(title_of_differences, compared, [("", differences)])
                blocks = [(f"level {level:g}", self._lines(everyone, level)) for level in self.levels]
                self._add(f"{title_here}, all levels", keys, blocks)
        self._add_regions(everyone)

    def _columns(self, kind: str, protocol: str | None) -> Iterator[Key]:
        """Columns of a table over the whole image: of the metrics' own frames, or of another protocol."""
        for name, metric in self.catalogue.items():
            if metric.table == kind and protocol != metric.protocol:
                yield name, protocol or metric.protocol, "full"

    def _has_records(self, key: Key) -> bool:
        return any(cell[:3] == key for cell in self.cells)

    def _lines(self, subject: str, level: float) -> list[Line]:
        return [(variant, subject, level, variant, "") for variant in self.variants]

    def _differences(self, subject: str, level: float) -> list[Line]:
        others = [variant for variant in self.variants if variant != self.reference]
        return [(f"minus {other}", subject, level, self.reference, other) for other in others]

    def _add(
        self,
        title: str,
        keys: list[Key],
        blocks: Iterable[tuple[str, list[Line]]],
        published: Mapping[str, Mapping[str, str]] | None = None,
    ) -> None:
        """Append a table, unless it has no values and no reasons."""
        blocks = [(heading, [line for line in lines if self._found(keys, line)]) for heading, lines in blocks]
        blocks = [(heading, lines) for heading, lines in blocks if lines]
        if not keys or not blocks:
            return
        lines = [line for _, lines in blocks for line in lines]
        counts = {key: self._counts(key, lines) for key in keys}
        filled = [
            (heading, [(line[0], [self._cell(key, line, len(counts[key]) > 1) for key in keys]) for line in lines])
            for heading, lines in blocks
        ]
        if published:
            values = [(name, [Cell(row.get(key[0], NO_VALUE)) for key in keys]) for name, row in published.items()]
            filled.append(("published by the paper", values))
        header = [self._heading(key, counts[key]) for key in keys]
        self.document.tables.append(Table(f"{self.title}: {title}", header, filled))

    def _found(self, keys: Iterable[Key], line: Line) -> bool:
        return any((*key, *line[1:]) in self.cells for key in keys)

    def _counts(self, key: Key, lines: Iterable[Line]) -> set[str]:
        """The numbers of frames and seeds of a column."""
        return {_count(s) for line in lines if (s := self.cells.get((*key, *line[1:]))) and s.n}

    def _heading(self, key: Key, counts: set[str]) -> str:
        metric, n = self.catalogue[key[0]], min(counts) if len(counts) == 1 else ""
        details = ", ".join(filter(None, (metric.unit, key[1], n)))
        return f"{metric.title}{ARROWS[metric.better]} ({details})"

    def _cell(self, key: Key, line: Line, with_count: bool) -> Cell:
        """The cell of a column in a line."""
        metric, summary = self.catalogue[key[0]], self.cells.get((*key, *line[1:]))
        if summary is None:
            return Cell(NO_VALUE)
        if pd.isna(summary.mean):
            return Cell(NO_VALUE, note=self.document.note(summary.reason))
        pattern = f"{{:{'+' if summary.minus else ''}.{metric.digits}f}}"
        interval = "" if pd.isna(summary.low) else f"[{pattern}, {pattern}]".format(summary.low, summary.high)
        note = _count(summary) if with_count else ""
        return Cell(
            pattern.format(summary.mean), interval, note, not summary.minus and self._is_best(key, line, metric)
        )

    def _is_best(self, key: Key, line: Line, metric: Metric) -> bool:
        """Whether a variant is better than every other one by more than the interval of their difference."""
        _, subject, level, variant, _ = line
        own = (*key, subject, level)
        others = [other for other in self.variants if other != variant and self._measured((*own, other, ""))]
        differences = [self.cells.get((*own, variant, other)) for other in others]
        return bool(others) and all(difference and _is_better(difference, metric) for difference in differences)

    def _measured(self, cell: tuple) -> bool:
        return cell in self.cells and not pd.isna(self.cells[cell].mean)

    def _add_regions(self, subject: str) -> None:
        """PSNR by region and its differences, at the highest level that has a truth."""
        measured = [level for level in self.levels for v in self.variants
                    if self._measured(("psnr", "test", "full", subject, level, v, ""))]  # fmt: skip
        if not measured or "psnr" not in self.catalogue:
            return
        level, metric = max(measured), self.catalogue["psnr"]
        for lines, what in (
            (self._lines(subject, level), "PSNR by region"),
            (self._differences(subject, level), f"PSNR by region, {self.reference} minus the others, paired by frame"),
        ):
            keys = [("psnr", "test", region) for region in REGIONS]
            keys = [key for key in keys if any(self._found([key], line) for line in lines)]
            counts = {key: self._counts(key, lines) for key in keys}
            body = [
                (
                    key[2] + (f" ({min(n)})" if len(n) == 1 else ""),
                    [self._cell(key, line, len(n) > 1) for line in lines],
                )
                for key, n in counts.items()
            ]
            if body:
                header = [f"{line[0]}{ARROWS[metric.better]} ({metric.unit}, test)" for line in lines]
                self.document.tables.append(Table(f"{self.title}, level {level:g}: {what}", header, [("", body)]))


def _count(summary: Any) -> str:
    """Number of frames behind a mean, and of seeds if there are several."""
    return f"n={summary.n}" + (f", {summary.seeds} seeds" if summary.seeds > 1 else "")


def _is_better(difference: Any, metric: Metric) -> bool:
    if metric.better == "neither":
        return False
    return difference.low > 0 if metric.better == "higher" else difference.high < 0
