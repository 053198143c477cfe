"""Stage `tabulate`: means with intervals of all variants, subjects and levels of a study."""

from __future__ import annotations

from pathlib import Path

from carigs.files import writing
from carigs.settings import Tabulate
from evaluation.tables.rows import read_rows
from evaluation.tables.table import summarise, write_csv
from evaluation.tables.typeset import document, to_latex, to_markdown


def tabulate(settings: Tabulate, *, rows: list[Path], table: Path, markdown: Path, latex: Path) -> None:
    """Write `table` (tidy csv: everything), and the readable summaries `markdown` and `latex`."""
    summaries = summarise((row for file in rows for row in read_rows(file)), settings)
    readable = document(summaries, settings)
    write_csv(table, summaries)
    for file, text in ((markdown, to_markdown(readable)), (latex, to_latex(readable))):
        with writing(file) as part:
            part.write_text(text, encoding="utf-8")
