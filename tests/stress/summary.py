"""Outcomes of all stress suites in one table; fails if a case is wrong.

Example:
    PYTHONPATH=tests python -m stress.summary results/stress/summary.csv results/stress/r*.csv
"""

from __future__ import annotations

import csv
import io
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from evaluation.command_line import csv_parser, run
from evaluation.tables.csv_files import write_csv


class Count(NamedTuple):
    """Number of a suite's cases by outcome."""

    suite: str
    cases: int
    right: int
    typed_error: int
    wrong: int
    """Cases with any other outcome."""


def count_outcomes(suite: str, outcomes: Iterable[str]) -> Count:
    """Count the outcomes of a suite.

    Args:
        suite: Its name.
        outcomes: Outcome of every case.

    Returns:
        The counts.
    """
    counts = Counter(outcomes)
    right, typed_error = counts["right"], counts["typed error"]
    return Count(suite, counts.total(), right, typed_error, counts.total() - right - typed_error)


def main() -> bool:
    """Count the outcomes of suites, print the table and the wrong cases, and write the table.

    Returns:
        Whether a case is wrong.
    """
    parser = csv_parser(__doc__)
    parser.add_argument("suites", type=Path, nargs="+", help="rows of the suites; each file is named after its suite")
    arguments = parser.parse_args()
    suites = {file.stem: list(csv.DictReader(io.StringIO(file.read_text("utf-8")))) for file in arguments.suites}
    counts = [count_outcomes(suite, (row["outcome"] for row in rows)) for suite, rows in suites.items()]
    total = Count("total", *(sum(column) for column in zip(*(count[1:] for count in counts), strict=True)))
    write_csv(arguments.rows, [*counts, total], Count)
    print(f"{'suite':<14} {'cases':>6} {'right':>6} {'typed error':>12} {'wrong':>6}")
    for count in (*counts, total):
        print(f"{count.suite:<14} {count.cases:>6} {count.right:>6} {count.typed_error:>12} {count.wrong:>6}")
    for suite, rows in suites.items():
        for row in rows:
            if row["outcome"] not in ("right", "typed error"):
                print(f"{suite}: {row['case']}: {row.get('detail') or row['outcome']}")
    return total.wrong > 0


if __name__ == "__main__":
    run(main)
