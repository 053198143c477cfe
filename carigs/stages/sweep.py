"""Stage `sweep`: the table and the figure of all combinations of values of a sweep."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from carigs.errors import SettingsError
from carigs.runs.job_record import job_costs
from carigs.settings import Sweep
from carigs.system.files import writing
from evaluation.figures.sweep_plot import plot_sweep
from evaluation.metrics.catalogue import CATALOGUE
from evaluation.tables.document import to_markdown
from evaluation.tables.summary_file import read_summaries
from evaluation.tables.sweep_table import CombinationResults, measures, sweep_document, sweep_table, write_sweep


def sweep(
    settings: Sweep,
    *,
    tables: Sequence[Path],
    swept_keys: Sequence[str],
    swept_values: Sequence[Sequence[str]],
    seeds: Sequence[Sequence[str]],
    table: Path,
    markdown: Path,
    figure: Path,
    vector: Path,
) -> None:
    """Write the table of a sweep as CSV and as Markdown, and its figure.

    Args:
        settings: Metrics that are shown, and their level.
        tables: Summary of each combination, `results/{study}/table/gamma={gamma}.csv` of the stage `tabulate`.
        swept_keys: Keys with several values.
        swept_values: Text of the value of each key, for each combination.
        seeds: Seeds of the trainings of each combination, as in paths.
        table: CSV file to write.
        markdown: Markdown file to write.
        figure: PNG file to write.
        vector: PDF file to write, the same figure: `figure` with the suffix `.pdf`.

    Raises:
        SettingsError: A metric is unknown.
        InputError: A table, or the record of a job, is malformed.
    """
    for name in settings.metrics:
        if name not in CATALOGUE:
            raise SettingsError(f"sweep.metrics: {name} is unknown; known: {', '.join(CATALOGUE)}")
    folders = [file.parents[1] for file in tables]
    costs = {folder: job_costs(folder / "log") for folder in dict.fromkeys(folders)}
    combinations = (
        CombinationResults(tuple(texts), tuple(own), folder.as_posix(), read_summaries(file), costs[folder])
        for texts, own, folder, file in zip(swept_values, seeds, folders, tables, strict=True)
    )
    found = sweep_table(swept_keys, combinations, settings.level, CATALOGUE)
    shown = measures(found, settings.metrics, CATALOGUE)
    if not shown:
        level = "gamma" if settings.level is None else f"{settings.level:g}"
        raise SettingsError(f"no metric of sweep.metrics has a value at level {level}")
    left_out = [CATALOGUE[name].title for name in settings.metrics if name not in shown]
    plot_sweep(figure, found, swept_keys, shown)  # writes `vector`, too
    with writing(markdown) as part:
        part.write_text(to_markdown(sweep_document(found, swept_keys, shown, left_out)), encoding="utf-8")
    write_sweep(table, found)
