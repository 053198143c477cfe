"""Stage `tabulate`: means with intervals of all variants, subjects and levels of a study (table 1 of the paper)."""

from __future__ import annotations

from pathlib import Path

from carigs.settings import Tabulate
from carigs.system.files import writing
from evaluation.metrics.catalogue import CATALOGUE
from evaluation.tables.document import to_latex, to_markdown
from evaluation.tables.summary import read_metrics, summarise
from evaluation.tables.summary_file import write_summaries
from evaluation.tables.typeset import comparison_tables


def tabulate(settings: Tabulate, *, records: list[Path], table: Path, markdown: Path, latex: Path) -> None:
    """Write the summary of a study as tidy CSV and as readable tables.

    Args:
        settings: Resampling, reference variant and number of digits.
        records: Metric records of all avatars and levels.
        table: CSV file to write: every mean and paired difference.
        markdown: Markdown file to write: the comparison tables.
        latex: LaTeX file to write: the same tables.

    Raises:
        InputError: A file of records is malformed.
    """
    summaries = summarise(read_metrics(records), settings, CATALOGUE)
    document = comparison_tables(summaries, settings, CATALOGUE)
    write_summaries(table, summaries)
    for file, text in ((markdown, to_markdown(document)), (latex, to_latex(document))):
        with writing(file) as part:
            part.write_text(text, encoding="utf-8")
