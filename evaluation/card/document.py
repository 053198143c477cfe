"""A card as text and tables for readers: card.md, and the first part of the report."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sized
from pathlib import Path
from typing import Any, NamedTuple

from carigs.system.files import writing
from evaluation.card.card import BenchmarkCard, CardValue, find_values
from evaluation.card.measures import AVATAR_MEASURES, STAGE_MEASURES
from evaluation.tables.document import NO_VALUE, Cell, Document, Table, to_markdown
from evaluation.tables.factors import interval_scope
from evaluation.tables.metric import TABLES
from evaluation.tables.metric_records import REGIONS
from evaluation.tables.summary import ALL
from evaluation.tables.typeset import ARROWS

ARROW_KEY = "↑: higher is better, ↓: lower is better, no arrow: the value alone says neither."


class Part(NamedTuple):
    """A part of the card: a heading, paragraphs, tables, and what follows them."""

    heading: str
    paragraphs: list[str]
    tables: list[Table]
    items: list[str]
    """A list below the tables."""


def card_parts(card: BenchmarkCard) -> list[Part]:
    """Arrange a card for readers.

    Args:
        card: The card.

    Returns:
        Its parts, in their order.
    """
    tables = _CardTables(card)
    top, what = max(card.levels), f"level {max(card.levels):g}"
    images = ", ".join(f"{name} {width} x {height}" for name, (width, height) in card.images.items())
    parts = [
        Part("What was measured", _introduction(card, images), [], []),
        tables.frames("Images at level 0", "truth", 0.0, "Renderings of the natural face beside captured frames."),
        tables.regions(
            f"Against the true caricature, {what}",
            top,
            "Only a synthetic subject, or one with a sculpture that was photographed, has true caricatures.",
        ),
        tables.by_level("Identity against the level", "identity", "How well the person is still recognised."),
        tables.frames(f"{TABLES['geometry']}, {what}", "geometry", top, "Whether the surfels follow the mesh."),
        tables.frames(f"The measures of the paper, {what}", "paper", top, "As table 1 of the paper."),
        tables.frames(f"{TABLES['readings']}, {what}", "readings", top, ""),
        tables.frames(f"{TABLES['further']}, {what}", "further", top, ""),
        tables.avatars(),
        tables.stages(),
        Part("What the numbers are", [ARROW_KEY], [], _meanings(card)),
        Part("How the card was made", [], [], _provenance(card)),
    ]
    missing = [f"{kind}: {reason}" for kind, reason in card.not_measured.items()] + tables.notes.notes
    if missing:
        parts.append(Part("What is missing", ["Values that could not be measured, and why."], [], missing))
    return [part for part in parts if part.paragraphs or part.tables or part.items]


def write_markdown(file: Path, card: BenchmarkCard) -> None:
    """Write a card as Markdown.

    Args:
        file: File to write.
        card: The card.
    """
    lines = [f"# Caricature benchmark card: {_plain(card.study)}, trained for level {card.gamma:g}\n"]
    for part in card_parts(card):
        lines.append(f"## {part.heading}\n")
        lines += [f"{_plain(paragraph)}\n" for paragraph in part.paragraphs]
        if part.tables:
            lines.append(to_markdown(Document(tables=part.tables)))
        if part.items:
            lines.append("\n".join(f"- {_plain(item)}" for item in part.items) + "\n")
    with writing(file) as part:
        part.write_text("\n".join(lines), encoding="utf-8")


def _plain(text: str) -> str:
    """Text without what Markdown would take for HTML."""
    return text.replace("<", "&lt;")


def _introduction(card: BenchmarkCard, images: str) -> list[str]:
    percent = f"{card.intervals['confidence']:.0%}"
    trained = card.training_seeds
    of_seeds = f", each trained with {_counted(trained, 'seed')} ({', '.join(map(str, trained))})" if trained else ""
    variants, levels = ", ".join(card.variants), ", ".join(f"{level:g}" for level in card.levels)
    return [
        f"Study {card.study}: {_counted(card.subjects, 'subject')} ({', '.join(card.subjects)}), "
        f"{_counted(card.variants, 'variant')} of training ({variants}){of_seeds}, "
        f"for caricature level {card.gamma:g}, rendered at {_counted(card.levels, 'level')} ({levels}). Level 0 is the "
        "natural face; at the highest level its curvature is exaggerated most.",
        f"A number is a mean over n frames, with its {percent} confidence interval in brackets. "
        f"{interval_scope(card.subjects, len(trained))} Costs of stages are of one run and have no interval; those of "
        "avatars are over their seeds, and that of the time of a frame is over their renderings.",
        f"Images in pixels: {images}. Split into training and held-out frames: {card.split}. Protocols: "
        + "; ".join(f"{name}: {text}" for name, text in card.protocols.items() if name in ("test", "val", "orbit"))
        + ".",
    ]


def _counted(things: Sized, name: str) -> str:
    return f"{len(things)} {name}{'s' * (len(things) != 1)}"


def _meanings(card: BenchmarkCard) -> list[str]:
    words = {"higher": "higher is better", "lower": "lower is better", "neither": "neither direction is better"}
    return [
        f"{measure['title']}: {measure['meaning']}; {words[measure['better']]}"
        + (f"; unit {measure['unit']}" if measure["unit"] else "")
        + f" (in card.json: {name})."
        for name, measure in card.measures.items()
    ]


def _provenance(card: BenchmarkCard) -> list[str]:
    machine, commit = card.machine, card.commit
    known = f"{commit['id']}{', with changes that are not committed' if commit['modified'] else ''}"
    place = machine["processor"]
    if machine["cores"]:
        place += f", {machine['cores']} cores, {machine['memory_gb']:g} GiB of memory, {machine['system']}"
    return [
        f"Machine that wrote the card: {place}. Jobs of a cluster ran on its nodes.",
        f"Commit: {known if commit['id'] else NO_VALUE + ', ' + commit['reason']}.",
        "Versions: " + ", ".join(f"{name} {number}" for name, number in card.versions.items()) + ".",
        "Other seeds: " + ", ".join(f"{name} = {seed}" for name, seed in card.seeds.items()) + ".",
        "Intervals: {method}; {resamples} resamples, seed {seed}.".format(**card.intervals),
    ]


class _CardTables:
    """The tables of a card; they share the notes on what is missing."""

    def __init__(self, card: BenchmarkCard) -> None:
        self.card, self.notes = card, Document()
        self.subject = ALL if any(value.subject == ALL for value in card.values) else card.subjects[0]

    def frames(self, heading: str, kind: str, level: float, text: str) -> Part:
        """Metrics of a kind at one level: a table per protocol, a line per variant."""
        measures, tables = self._measures(kind), []
        values = find_values(self.card, measures)
        for protocol in ("test", "val", "orbit"):
            shown = [name for name in measures if self._any(values, name, level, protocol, "full")]
            lines = [
                (variant, [self._cell(values.get((name, self.subject, variant, level, protocol, "full")))
                           for name in shown])
                for variant in self.card.variants
            ]  # fmt: skip
            if shown:
                tables.append(Table(f"Frames: {protocol}", self._headings(shown), [("", lines)]))
        return Part(heading, [text] if tables and text else [], tables, [])

    def regions(self, heading: str, level: float, text: str) -> Part:
        """Metrics against the truth at one level: a block per region, a line per variant."""
        measures, blocks = self._measures("truth"), []
        values = find_values(self.card, measures)
        shown = [name for name in measures if any(key[0] == name and key[3] == level for key in values)]
        for region in REGIONS:
            if any(self._any(values, name, level, "test", region) for name in shown):
                lines = [
                    (variant, [self._cell(values.get((name, self.subject, variant, level, "test", region)))
                               for name in shown])
                    for variant in self.card.variants
                ]  # fmt: skip
                blocks.append((f"region {region}", lines))
        tables = [Table("Frames: test", self._headings(shown), blocks)] if blocks else []
        return Part(heading, [text] if tables else [], tables, [])

    def by_level(self, heading: str, kind: str, text: str) -> Part:
        """Metrics of a kind against the level: a table per metric, a line per variant."""
        measures, tables = self._measures(kind), []
        values, levels = find_values(self.card, measures), self.card.levels
        for name in measures:
            protocol = self.card.measures[name]["protocol"]
            lines = [
                (variant, [self._cell(values.get((name, self.subject, variant, level, protocol, "full")))
                           for level in levels])
                for variant in self.card.variants
            ]  # fmt: skip
            title = f"{self._headings([name])[0]}, frames: {protocol}"
            tables.append(Table(title, [f"level {level:g}" for level in levels], [("", lines)]))
        return Part(heading, [text] if tables else [], tables, [])

    def avatars(self) -> Part:
        """Costs of the avatars: a line per subject and variant, which stands for all seeds."""
        shown = [name for name in AVATAR_MEASURES if name in self.card.measures]
        values = find_values(self.card, shown)
        lines = [
            (f"{subject}, {variant}", [self._cell(values.get((name, subject, variant, None, "avatar", "")), "single")
                                       for name in shown])
            for subject in self.card.subjects
            for variant in self.card.variants
        ]  # fmt: skip
        tables = [Table("Avatars", self._headings(shown), [("", lines)])] if shown else []
        text = "The time of a frame includes posing and shading, which a viewer does once for all views of a pose."
        return Part("Avatars: size and speed", [text] if tables else [], tables, [])

    def stages(self) -> Part:
        """Costs of the stages: a line per stage."""
        shown = [name for name in STAGE_MEASURES if name in self.card.measures]
        values = find_values(self.card, shown)
        names = list(dict.fromkeys(key[5] for key in values))
        lines = [
            (stage, [self._cell(values.get((name, "", "", None, "stage", stage))) for name in shown]) for stage in names
        ]
        tables = [Table("Stages of the study", self._headings(shown), [("", lines)])] if lines else []
        text = "Costs of the jobs that made the results, which may have run at the same time; n is their number."
        return Part("Time and memory of the stages", [text] if tables else [], tables, [])

    def _measures(self, kind: str) -> list[str]:
        costs = {*AVATAR_MEASURES, *STAGE_MEASURES}
        return [name for name, m in self.card.measures.items() if m["kind"] == kind and name not in costs]

    def _any(self, values: Mapping[tuple, CardValue], name: str, level: float, protocol: str, region: str) -> bool:
        keys = ((name, self.subject, variant, level, protocol, region) for variant in self.card.variants)
        return any(key in values for key in keys)

    def _headings(self, names: Iterable[str]) -> list[str]:
        return [_heading(self.card.measures[name]) for name in names]

    def _cell(self, value: CardValue | None, kind: str = "mean") -> Cell:
        if value is None:
            return Cell(NO_VALUE)
        if value.value is None:
            return Cell(NO_VALUE, note=self.notes.note(value.reason))
        pattern = f"{{:.{self.card.measures[value.measure]['digits']}f}}"
        interval = "" if value.low is None or value.high is None else f"[{pattern}, {pattern}]"
        count = "" if kind == "single" and value.n == 1 else f"n={value.n}"
        note = " ".join(filter(None, (count, value.reason and self.notes.note(value.reason))))
        return Cell(pattern.format(value.value), interval.format(value.low, value.high), note)


def _heading(measure: Mapping[str, Any]) -> str:
    unit = f" ({measure['unit']})" if measure["unit"] else ""
    return f"{measure['title']}{ARROWS[measure['better']]}{unit}"
