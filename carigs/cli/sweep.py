"""`carigs sweep`: make a study at every combination of values, and a table and a figure of all of them."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from carigs.cli.run import make_studies, parse_run, run_parser
from carigs.config import compose, read_sweep, rendered_levels, split_sweep
from carigs.config.sweep import Combination, SweepGrid
from carigs.errors import SettingsError, print_line
from carigs.planning.study_subjects import check_subjects

DESCRIPTION = """Make a study at every combination of values, side by side, and a table and a figure of all of them.

A combination that fails does not stop the others. What is made is kept: the same command goes on.
"""
EXAMPLES = """examples:
  carigs sweep gamma=0.1,0.15,0.2,0.25
  carigs sweep gamma=0.1,0.25 train.num_gtstar_levels=1,4 --cores 2       four combinations
  carigs sweep "capture.toy.seed=range(5)" --dry-run
  carigs sweep gamma=0.1,0.25 --target sweep --target reproduce           figures, card and report of each study, too
"""
MAX_NAMED = 10
"""Combinations that failed and are named."""


def main(arguments: list[str]) -> int:
    """Run the subcommand.

    Args:
        arguments: Its command line.

    Returns:
        Exit code: 1 if a combination failed.

    Raises:
        SettingsError: For wrong overrides, before Snakemake starts, and if no key has several values.
    """
    options = parse_run(run_parser("sweep", DESCRIPTION, EXAMPLES), arguments)
    overrides, swept = split_sweep(options.overrides)
    if not swept:
        raise SettingsError("no key has several values, as in gamma=0.1,0.2; one study is made by `carigs run`")
    sweep = read_sweep(overrides, swept)
    for combination in _along_axes(sweep):
        check_subjects(combination.overrides)
    _check_table(sweep)
    studies = dict.fromkeys([*(combination.study for combination in sweep.combinations), sweep.study])
    succeeded, logs = make_studies(overrides, swept, studies, options)
    if failed := [combination for combination in sweep.combinations if _concerns(combination, logs)]:
        print_line(f"failed: {_names(sweep, failed)}; the others are kept for the next run")
    return 0 if succeeded else 1


def _along_axes(sweep: SweepGrid) -> Iterable[Combination]:
    """The combinations that differ from the first in one value at most: every value is in one of them."""
    first = sweep.combinations[0].values
    for combination in sweep.combinations:
        if sum(value != other for value, other in zip(combination.values, first, strict=True)) <= 1:
            yield combination


def _check_table(sweep: SweepGrid) -> None:
    """Refuse what the table of the sweep would refuse after everything is trained."""
    from evaluation.metrics.catalogue import CATALOGUE

    configs = [compose(*combination.overrides) for combination in _along_axes(sweep)]
    for name in configs[0].sweep.metrics:
        if name not in CATALOGUE:
            raise SettingsError(f"sweep.metrics: {name} is unknown; known: {', '.join(CATALOGUE)}")
    level, rendered = configs[0].sweep.level, {level for config in configs for level in rendered_levels(config)}
    if level is not None and f"{level:g}" not in rendered:
        raise SettingsError(
            f"sweep.level={level:g} is not rendered; rendered: {', '.join(sorted(rendered, key=float))}"
        )


def _concerns(combination: Combination, logs: Iterable[Path]) -> bool:
    """Whether a job of a combination is among those with these logs; jobs without gamma are those of all gammas."""
    own = [log for log in logs if log.parents[2].name == combination.study]
    if not own:
        return False
    gamma = f"gamma={compose(*combination.overrides).gamma:g}"
    return any(gamma in log.stem.split(",") or "gamma=" not in log.stem for log in own if log.parent.name != "sweep")


def _names(sweep: SweepGrid, combinations: list[Combination]) -> str:
    """Values of combinations in one line."""
    shown = [
        " ".join(f"{key}={value}" for key, value in zip(sweep.keys, combination.values, strict=True))
        for combination in combinations[:MAX_NAMED]
    ]
    more = len(combinations) - len(shown)
    return "; ".join(shown) + (f" and {more} more" if more else "")
